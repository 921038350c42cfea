from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.scene import Cylinder, Scene, Sphere, Surface
from rigcal.targets.target import Target, TargetConfig

SQUARE = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
BOARD = Target("board", TargetConfig(type="plain"), 0.5 * SQUARE, np.zeros((0, 3)))
FACING = np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]])
"""Columns: right, up and outward axes of a board that is seen along x."""
ORIGIN = np.zeros(3)


def at(x: float, y: float = 0.0, z: float = 0.0, R: Array | None = None) -> Array:
    return se3.transform(np.eye(3) if R is None else R, np.array([x, y, z]))


def unit(*vectors: tuple[float, float, float]) -> Array:
    d = np.array(vectors, dtype=np.float64)
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def ranges(scene: Scene, p_w: Array, d_w: Array) -> list[float]:
    return scene.cast(p_w, d_w)[0].tolist()


def only(shape: Cylinder | Sphere) -> Scene:
    return Scene(BOARD, None, solids=(shape,))


def test_a_sphere_is_met_where_the_ray_enters_it() -> None:
    scene = only(Sphere(at(3.0), 0.5))
    assert ranges(scene, ORIGIN, unit((1, 0, 0))) == pytest.approx([2.5])
    # 0.3 m beside the centre the surface lies 0.4 m before it.
    assert ranges(scene, np.array([0, 0.3, 0]), unit((1, 0, 0))) == pytest.approx([2.6])
    misses = unit((-1, 0, 0), (0, 1, 0), (3, 0.6, 0))
    assert ranges(scene, ORIGIN, misses) == [np.inf] * 3


def test_a_ray_from_inside_leaves_through_the_far_side() -> None:
    sphere, cylinder = only(Sphere(at(1.0), 2.0)), only(Cylinder(at(1.0), 2.0, 6.0))
    along = unit((1, 0, 0), (-1, 0, 0))
    assert ranges(sphere, ORIGIN, along) == pytest.approx([3.0, 1.0])
    assert ranges(cylinder, ORIGIN, along) == pytest.approx([3.0, 1.0])
    assert ranges(cylinder, ORIGIN, unit((0, 0, 1), (0, 0, -1))) == pytest.approx([3.0, 3.0])


def test_a_cylinder_has_a_mantle_and_two_ends() -> None:
    scene = only(Cylinder(at(3.0, 0.0, 1.0), 0.5, 2.0))
    assert ranges(scene, np.array([0, 0, 1.0]), unit((1, 0, 0))) == pytest.approx([2.5])
    assert ranges(scene, np.array([3.2, 0, 5.0]), unit((0, 0, -1))) == pytest.approx([3.0])
    assert ranges(scene, np.array([3.2, 0, -1]), unit((0, 0, 1))) == pytest.approx([1.0])
    # Down at 45 degrees through the top, half-way to the axis.
    start = np.array([1.75, 0, 3.0])
    assert ranges(scene, start, unit((1, 0, -1))) == pytest.approx([np.sqrt(2)], abs=1e-12)
    over, beside, behind = np.array([0, 0, 2.1]), np.array([0, 0.6, 1.0]), np.array([5.0, 0, 1])
    for start in (over, beside, behind):
        assert ranges(scene, start, unit((1, 0, 0))) == [np.inf]


def test_rays_in_the_plane_of_an_end_and_along_the_axis_are_no_trouble() -> None:
    scene = only(Cylinder(at(3.0), 0.5, 2.0))
    level = ranges(scene, np.array([0.0, 0.0, 1.0]), unit((1, 0, 0)))[0]
    assert level == pytest.approx(2.5) or level == np.inf
    assert ranges(scene, np.array([3.0, 0, 4]), unit((0, 0, -1))) == pytest.approx([3.0])


def test_the_nearest_hides_what_is_behind() -> None:
    wall = Surface(at(6.0, R=FACING), 5 * SQUARE)
    ball, post = Sphere(at(4.0, 1.0), 0.5), Cylinder(at(2.0, -0.8), 0.1, 2.0)
    scene = Scene(BOARD, at(3.0, R=FACING), (wall,), (post, ball))
    d_w = unit((1, 0, 0), (4, 1, 0), (2, -0.8, 0), (1, 0.7, 0), (-1, 0, 0))
    t, hit = scene.cast(ORIGIN, d_w)
    assert hit.tolist() == [0, 3, 2, 1, -1]
    assert t[:3] == pytest.approx([3.0, np.hypot(4, 1) - 0.5, np.hypot(2, 0.8) - 0.1])
    assert t[3] == pytest.approx(6 * np.hypot(1, 0.7))
    nearer = Scene(BOARD, at(3.0, R=FACING), (wall,), (Sphere(at(2.0), 0.2),))
    assert nearer.cast(ORIGIN, d_w[:1])[1].tolist() == [2]


def test_each_ray_may_have_its_own_origin() -> None:
    scene = Scene(BOARD, at(3.0, R=FACING), (), (Sphere(at(2.0, 2.0), 0.5),))
    p_w = np.array([[0.0, 0, 0], [0, 2, 0], [4, 2, 0], [0, 4, 0]])
    t, hit = scene.cast(p_w, unit((1, 0, 0), (1, 0, 0), (-1, 0, 0), (1, 0, 0)))
    assert hit.tolist() == [0, 1, 1, -1]
    assert t[:3] == pytest.approx([3.0, 1.5, 1.5])


def test_no_rays_and_no_shapes() -> None:
    assert Scene(BOARD, None).cast(ORIGIN, unit((1, 0, 0)))[1].tolist() == [-1]
    for origins in (ORIGIN, np.zeros((0, 3))):
        assert len(Scene(BOARD, at(3.0)).cast(origins, np.zeros((0, 3)))[0]) == 0


@given(st.integers(0, 10_000))
def test_hits_lie_on_the_shape_and_no_ray_that_meets_it_is_lost(seed: int) -> None:
    """Aimed at a random point inside a shape, every ray hits, and its end is on the rim."""
    rng = np.random.default_rng(seed)
    T = se3.exp(rng.normal(0, 2.0, 6))
    radius, height = rng.uniform(0.05, 2.0, 2)
    p_w = T[:3, 3] + rng.normal(0, 4.0, (50, 3))
    inside = rng.uniform(-0.5, 0.5, (50, 3)) * [radius, radius, height]
    d_w = se3.apply(T, inside) - p_w
    d_w /= np.linalg.norm(d_w, axis=1, keepdims=True)
    for shape in (Cylinder(T, radius, height), Sphere(T, max(radius, height))):
        for origins in (p_w, p_w[0]):
            t, hit = only(shape).cast(origins, unit_to(se3.apply(T, inside), origins))
            assert np.all(hit == 1)
            end = origins + t[:, None] * unit_to(se3.apply(T, inside), origins)
            p_f = se3.apply(se3.inverse(T), end)
            if isinstance(shape, Sphere):
                off = np.linalg.norm(p_f, axis=1) - shape.radius
            else:
                reach = np.hypot(p_f[:, 0], p_f[:, 1]) - radius
                off = np.maximum(reach, np.abs(p_f[:, 2]) - height / 2)
            np.testing.assert_allclose(off, 0, atol=1e-9)


def unit_to(aims: Array, origins: Array) -> Array:
    d = aims - origins
    return d / np.linalg.norm(d, axis=1, keepdims=True)
