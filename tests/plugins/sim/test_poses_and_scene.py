from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.stats import kstest, uniform

from rigcal.errors import ConfigError
from rigcal.geometry import se3
from rigcal.plugin import Registry
from rigcal.rig import Rig, build_targets
from rigcal_sim.poses import board_pose
from rigcal_sim.sampling import sample_board_poses
from rigcal_sim.scenario import ScenarioConfig
from rigcal_sim.scene import build_scene

MakeRig = Callable[..., Rig]
BOARD = {
    "bearings_deg": [-30.0, 0.0, 30.0],
    "radii_m": [1.5, 2.5],
    "samples": 4,
    "max_roll_deg": 10.0,
    "max_pitch_deg": 20.0,
    "max_yaw_deg": 30.0,
    "height_m": [-0.1, 0.3],
}
ROOM = {"size_m": [9.0, 9.0, 3.0]}


def scenario(**changes: Any) -> ScenarioConfig:
    board = BOARD | changes.pop("board", {})
    return ScenarioConfig.model_validate({"version": 1, "board": board, **changes})


def test_an_unrotated_board_stands_upright_and_faces_the_origin() -> None:
    T_w_t = board_pose(90.0, 2.0, 0.5, np.zeros(3))
    np.testing.assert_allclose(T_w_t[:3, 3], [0, 2, 0.5], atol=1e-12)
    np.testing.assert_allclose(T_w_t[:3, 2], [0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(T_w_t[:3, 1], [0, 0, 1], atol=1e-12)
    # Who stands at the origin and looks along +y has +x at the right hand.
    np.testing.assert_allclose(T_w_t[:3, 0], [1, 0, 0], atol=1e-12)


def test_poses_keep_to_the_scenario(make_rig: MakeRig, registry: Registry) -> None:
    rig, wanted = make_rig(), scenario(room=ROOM)
    target = build_targets(rig, registry)["board"]
    poses = sample_board_poses(rig, registry, target, wanted, seed=1)
    assert poses.T_w_t.shape == (24, 4, 4)
    xy = poses.T_w_t[:, :2, 3]
    np.testing.assert_allclose(np.linalg.norm(xy, axis=1), np.tile([1.5] * 4 + [2.5] * 4, 3))
    bearings = np.degrees(np.arctan2(xy[:, 1], xy[:, 0]))
    np.testing.assert_allclose(bearings, np.repeat([-30.0, 0.0, 30.0], 8), atol=1e-9)
    heights = poses.T_w_t[:, 2, 3]
    assert heights.min() >= -0.1
    assert heights.max() <= 0.3
    assert np.ptp(heights) > 0.1
    facing = -np.einsum("ni,ni->n", poses.T_w_t[:, :2, 2], xy) / np.linalg.norm(xy, axis=1)
    assert facing.min() >= np.cos(np.radians(20)) * np.cos(np.radians(30)) - 1e-9
    assert facing.max() < 1 - 1e-4
    assert set(poses.seen_by) == {("a", "b")}


def test_roll_pitch_and_yaw_are_uniform_in_their_own_bounds(
    make_rig: MakeRig, registry: Registry
) -> None:
    """R(theta, r) of the seed, section 4.4.1."""
    rig, wanted = make_rig(), scenario(board={"samples": 150})
    target = build_targets(rig, registry)["board"]
    T_w_t = sample_board_poses(rig, registry, target, wanted, seed=1).T_w_t
    # R = Ry(yaw) Rx(pitch) Rz(roll), from the board that faces the z axis.
    bearings = np.degrees(np.arctan2(T_w_t[:, 1, 3], T_w_t[:, 0, 3]))
    level = np.array([board_pose(b, 1.0, 0.0, np.zeros(3)) for b in bearings])
    R = level[:, :3, :3].swapaxes(1, 2) @ T_w_t[:, :3, :3]
    roll = np.degrees(np.arctan2(R[:, 1, 0], R[:, 1, 1]))
    pitch = np.degrees(np.arcsin(-R[:, 1, 2]))
    yaw = np.degrees(np.arctan2(R[:, 0, 2], R[:, 2, 2]))
    for angle, limit in ((roll, 10.0), (pitch, 20.0), (yaw, 30.0)):
        assert np.abs(angle).max() <= limit + 1e-9
        assert kstest(angle, uniform(-limit, 2 * limit).cdf).pvalue > 0.01
    correlation = np.corrcoef([roll, pitch, yaw])
    assert np.abs(correlation - np.eye(3)).max() < 0.1


def test_number_of_poses_is_spread_over_bearings(make_rig: MakeRig, registry: Registry) -> None:
    rig = make_rig()
    target = build_targets(rig, registry)["board"]
    poses = sample_board_poses(rig, registry, target, scenario(), seed=1, poses=3)
    bearings = np.degrees(np.arctan2(*poses.T_w_t[:, 1::-1, 3].T))
    np.testing.assert_allclose(bearings, [-30, 0, 30], atol=1e-9)


def test_poses_that_too_few_sensors_see_are_drawn_again_or_refused(
    make_rig: MakeRig, registry: Registry
) -> None:
    rig = make_rig()
    target = build_targets(rig, registry)["board"]
    short_sighted = make_rig(range_max_m=1.52)
    edge = scenario(board={"radii_m": [1.5], "bearings_deg": [90.0]})
    poses = sample_board_poses(short_sighted, registry, target, edge, seed=1)
    assert poses.redrawn > 0
    assert all(len(seen) == 2 for seen in poses.seen_by)
    behind = scenario(board={"bearings_deg": [0.0, 180.0]})
    with pytest.raises(ConfigError, match=r"bearing 180 deg, radius 1.5 m.*no sensor sees it"):
        sample_board_poses(rig, registry, target, behind, seed=1)


def test_a_board_outside_the_room_is_refused(make_rig: MakeRig, registry: Registry) -> None:
    rig = make_rig()
    target = build_targets(rig, registry)["board"]
    small = scenario(room={"size_m": [4.0, 4.0, 3.0]})
    with pytest.raises(ConfigError, match=r"radius 2.5 m.*not fit into the room: enlarge"):
        sample_board_poses(rig, registry, target, small, seed=1)


def test_the_person_stands_behind_the_board_in_the_room(
    make_rig: MakeRig, registry: Registry
) -> None:
    rig, wanted = make_rig(), scenario(room=ROOM, person=True)
    target = build_targets(rig, registry)["board"]
    for T_w_t in sample_board_poses(rig, registry, target, wanted, seed=2).T_w_t:
        scene = build_scene(target, T_w_t, wanted, np.random.default_rng(0))
        grid = np.stack(np.meshgrid(np.linspace(-0.39, 0.39, 21), np.linspace(-0.29, 0.29, 21)))
        p_w = se3.apply(T_w_t, np.append(grid.reshape(2, -1).T, np.zeros((441, 1)), axis=1))
        ranges, hit = scene.cast(np.zeros(3), p_w / np.linalg.norm(p_w, axis=1)[:, None])
        assert np.all(hit == 0)
        np.testing.assert_allclose(ranges, np.linalg.norm(p_w, axis=1), atol=1e-9)
        at_chest = np.array([*T_w_t[:2, 3], 0.25])
        beyond = at_chest + 0.9 * at_chest / np.linalg.norm(at_chest)
        back_range, back = scene.cast(beyond, (at_chest - beyond)[None] / 0.9)
        assert back[0] > 6
        assert back_range[0] < 0.9


def test_a_room_is_closed(make_rig: MakeRig, registry: Registry) -> None:
    target = build_targets(make_rig(), registry)["board"]
    T_w_t = board_pose(0, 2.0, 0.2, np.zeros(3))
    scene = build_scene(target, T_w_t, scenario(room=ROOM), np.random.default_rng(0))
    d_w = np.random.default_rng(0).normal(size=(2000, 3))
    d_w /= np.linalg.norm(d_w, axis=1, keepdims=True)
    ranges, hit = scene.cast(np.zeros(3), d_w)
    assert np.all(hit >= 0)
    end = ranges[:, None] * d_w
    assert np.all(np.abs(end[:, :2]) < 4.5 + 1e-9)
    assert set(hit[end[:, 2] < -1 + 1e-9]) == {5}
    for surface in scene.surfaces:
        assert surface.T_w_f[:3, 2] @ (surface.T_w_f[:3, 3] - [0, 0, 0.5]) < 0
