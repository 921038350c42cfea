from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from rigcal.errors import ConfigError
from rigcal.geometry import se3
from rigcal.plugin import Registry
from rigcal.rig import Rig, build_targets
from rigcal.scene import Scene
from rigcal.targets import Target
from rigcal_sim.poses import board_pose, stream
from rigcal_sim.scenario import ScenarioConfig
from rigcal_sim.scenario_file import load_scenario
from rigcal_sim.scene import build_scene

MakeRig = Callable[..., Rig]
BOARD = {"bearings_deg": [0.0], "radii_m": [2.0]}
T_W_T = board_pose(0.0, 2.0, 0.3, np.zeros(3))


@pytest.fixture
def target(make_rig: MakeRig, registry: Registry) -> Target:
    return build_targets(make_rig(), registry)["board"]


def scene_with(target: Target, *objects: dict[str, Any], exposure: int = 0) -> Scene:
    scenario = ScenarioConfig.model_validate({"board": BOARD, "objects": objects})
    return build_scene(target, T_W_T, scenario, stream(1, exposure, "objects"))


def first_hits(scene: Scene, *directions: tuple[float, float, float]) -> list[float]:
    d_w = np.array(directions, dtype=np.float64)
    return scene.cast(np.zeros(3), d_w / np.linalg.norm(d_w, axis=1, keepdims=True))[0].tolist()


def test_solids_stand_where_the_scenario_says(target: Target) -> None:
    scene = scene_with(
        target,
        {"shape": "box", "size_m": [1, 2, 1], "translation_m": [0, 4, 0], "grey": 0.1},
        {"shape": "cylinder", "radius_m": 0.2, "height_m": 2, "translation_m": [-3, 0, 0]},
        {"shape": "sphere", "radius_m": 0.5, "translation_m": [0, -3, 0]},
        {"shape": "rectangle", "size_m": [2, 1], "translation_m": [-4, 0, 0.0]},
    )
    assert first_hits(scene, (0, 1, 0), (-1, 0, 0), (0, -1, 0)) == pytest.approx([3, 2.8, 2.5])
    # Past the cylinder the rectangle is met: 2 m wide, 1 m high.
    beyond = first_hits(scene, (-4, 0.9, 0.4), (-4, 1.1, 0), (-4, 0.9, 0.6))
    assert beyond == pytest.approx([np.linalg.norm([4, 0.9, 0.4]), np.inf, np.inf])


def test_things_are_turned_as_everywhere_in_rigcal(target: Target) -> None:
    thing = {"shape": "cylinder", "radius_m": 0.1, "height_m": 2, "translation_m": [0, 3, 0]}
    lying = scene_with(target, thing | {"rpy_deg": [0, 90, 0]})
    assert np.isfinite(first_hits(lying, (0.9, 3, 0), (0, 3, 0.9))).tolist() == [True, False]


def test_a_picture_stands_upright_and_is_not_mirrored(target: Target, tmp_path: Path) -> None:
    picture = np.array([[10, 20], [30, 40]], np.uint8)
    cv2.imwrite(str(tmp_path / "poster.png"), picture)
    thing = {"shape": "rectangle", "size_m": [2, 2], "texture": tmp_path / "poster.png"}
    scene = scene_with(target, thing | {"translation_m": [4, 0, 0], "rpy_deg": [0, 0, 180]})
    # It faces the origin: who looks along x has +y at the left hand.
    p_w = np.array([[4, y, z] for z in (0.5, -0.5) for y in (0.5, -0.5)])
    greys = scene.greys(p_w, np.ones(4, dtype=np.int64))
    np.testing.assert_allclose(greys * 255, [10, 20, 30, 40], atol=1e-9)


def test_a_decoy_looks_like_the_board_and_moves_with_every_exposure(target: Target) -> None:
    decoy = {"shape": "decoy", "beside_deg": [60, 90], "radius_m": [1.8, 2.2], "max_angle_deg": 10}
    poses = [scene_with(target, decoy, exposure=k).surfaces[0] for k in range(40)]
    xyz = np.array([s.T_w_f[:3, 3] for s in poses])
    bearings = np.degrees(np.arctan2(xyz[:, 1], xyz[:, 0]))
    assert np.all((np.abs(bearings) >= 60) & (np.abs(bearings) <= 90))
    assert 10 < np.sum(bearings > 0) < 30
    assert len(np.unique(bearings)) == 40
    np.testing.assert_allclose(xyz[:, 2], 0.3)
    radii = np.linalg.norm(xyz[:, :2], axis=1)
    assert radii.min() >= 1.8
    assert radii.max() <= 2.2
    for surface in poses:
        np.testing.assert_array_equal(surface.polygon, target.outline)
        facing = se3.apply(se3.inverse(surface.T_w_f), np.array([0, 0, 0.3]))
        assert facing[2] > 1.5
    again = scene_with(target, decoy, exposure=3).surfaces[0]
    np.testing.assert_array_equal(again.T_w_f, poses[3].T_w_f)


@pytest.mark.parametrize(
    ("thing", "message"),
    [
        ("{shape: cone, translation_m: [0, 0, 1]}", "shape: no shape 'cone' (has: "),
        ("{shape: box, size_m: [1, 1, 0], translation_m: [0, 0, 1]}", "found 0, expected a value"),
        ("{shape: sphere, radius_m: 1}", "objects[0]: key 'translation_m' is missing"),
        ("{shape: decoy, radius_m: [3, 2]}", "radius_m is [3, 2]; write [lowest, highest]"),
        (
            "{shape: rectangle, size_m: [1, 1], translation_m: [0, 0, 1], texture: no.png}",
            "objects[0].texture: cannot read 'no.png': No such file or directory; give the path",
        ),
        (
            "{shape: rectangle, size_m: [1, 1], translation_m: [0, 0, 1], texture: scenario.yaml}",
            "objects[0].texture: cannot read 'scenario.yaml': it holds no image; give the path",
        ),
    ],
)
def test_a_wrong_object_is_refused_with_what_to_change(
    make_rig: MakeRig, registry: Registry, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, thing: str, message: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    path = Path("scenario.yaml")
    path.write_text(
        f"version: 1\nboard: {{bearings_deg: [0], radii_m: [2]}}\nobjects:\n- {thing}\n"
    )
    with pytest.raises(ConfigError) as caught:
        load_scenario(path, make_rig(), registry)
    assert str(caught.value).startswith("scenario.yaml:4: objects[0]")
    assert message in str(caught.value)


def test_textures_are_looked_for_beside_the_scenario(
    make_rig: MakeRig, registry: Registry, target: Target, tmp_path: Path
) -> None:
    cv2.imwrite(str(tmp_path / "wall.png"), np.full((4, 4), 200, np.uint8))
    path = tmp_path / "scenario.yaml"
    thing = "{shape: rectangle, size_m: [1, 1], translation_m: [0, 3, 0], texture: wall.png}"
    path.write_text(f"board: {{bearings_deg: [0], radii_m: [2]}}\nobjects: [{thing}]\n")
    scenario = load_scenario(path, make_rig(), registry)
    scene = build_scene(target, T_W_T, scenario, np.random.default_rng(0))
    assert scene.surfaces[0].texture is not None
    assert scene.surfaces[0].texture.tolist() == [[200] * 4] * 4
