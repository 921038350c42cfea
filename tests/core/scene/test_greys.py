from __future__ import annotations

import numpy as np
import pytest

from rigcal.geometry.se3 import Array
from rigcal.scene import Cylinder, Scene, Sphere, Surface
from rigcal.targets.target import Target, TargetConfig

OUTLINE = np.array([[0.0, 0], [4, 0], [4, 2], [0, 2]])
BOARD = Target("board", TargetConfig(type="plain"), OUTLINE, np.zeros((0, 3)))
PICTURE = np.array([[0, 51, 102, 153], [204, 255, 0, 51]], np.uint8)
"""One texel per square metre of the outline."""


def greys_at(scene: Scene, hit: int, *points: tuple[float, float], **options: float) -> Array:
    p_w = np.column_stack([np.array(points), np.zeros(len(points))])
    return scene.greys(p_w, np.full(len(points), hit), **options)


def test_plain_things_have_their_grey_and_target_and_nothing_have_none() -> None:
    T = np.eye(4)
    scene = Scene(
        BOARD, T, (Surface(T, OUTLINE, 0.25),), (Cylinder(T, 1, 1, 0.75), Sphere(T, 1, 0.125))
    )
    greys = scene.greys(np.zeros((5, 3)), np.array([1, 2, 3, 0, -1]))
    np.testing.assert_array_equal(greys, [0.25, 0.75, 0.125, np.nan, np.nan])


def test_a_texture_is_stretched_over_the_outline_with_its_first_row_on_top() -> None:
    scene = Scene(BOARD, None, (Surface(np.eye(4), OUTLINE, texture=PICTURE),))
    middles = [(x + 0.5, y + 0.5) for y in (1, 0) for x in range(4)]
    np.testing.assert_allclose(greys_at(scene, 1, *middles) * 255, PICTURE.ravel(), atol=1e-9)
    corners = greys_at(scene, 1, (0, 2), (4, 2), (0, 0), (4, 0)) * 255
    np.testing.assert_allclose(corners, [0, 153, 204, 51], atol=1e-9)


def test_between_texels_greys_are_interpolated() -> None:
    scene = Scene(BOARD, None, (Surface(np.eye(4), OUTLINE, texture=PICTURE),))
    greys = greys_at(scene, 1, (1.0, 1.5), (0.75, 1.5), (1.0, 1.0)) * 255
    assert greys == pytest.approx([25.5, 12.75, (0 + 51 + 204 + 255) / 4])


def test_a_pixel_sees_the_mean_of_what_it_covers() -> None:
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 256, (200, 400), dtype=np.uint8)
    scene = Scene(BOARD, None, (Surface(np.eye(4), OUTLINE, texture=picture),))
    (grey,) = greys_at(scene, 1, (1.0, 1.5), footprint_m=0.4) * 255
    assert grey == pytest.approx(picture[30:70, 80:120].mean())
    (all_of_it,) = greys_at(scene, 1, (2.0, 1.0), footprint_m=10.0) * 255
    assert all_of_it == pytest.approx(picture.mean())
