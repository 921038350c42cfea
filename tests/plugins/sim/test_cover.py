"""Boards that cover the views of the sensors: near and far, middle and borders."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.observation import Detection
from rigcal.plugin import Registry, SensorConfig, SensorType, hookimpl
from rigcal.rig import Rig, build_targets, parse_rig
from rigcal_sim.cover import Coverage, spread
from rigcal_sim.sampling import BoardPoses, sample_board_poses
from rigcal_sim.scenario import ScenarioConfig
from rigcal_sim.sight import sensor_poses, spots_in_view

MakeRig = Callable[..., Rig]


class ConeConfig(SensorConfig, frozen=True):
    """It sees a cone of `half_deg` about x, or that sector of its plane."""

    type: Literal["cone"] = "cone"
    half_deg: float = 40.0


class SectorConfig(ConeConfig, frozen=True):
    type: Literal["sector"] = "sector"  # type: ignore[assignment]


def _sees(points: Array, config: Any) -> Any:
    return points[:, 0] > np.linalg.norm(points, axis=1) * np.cos(np.radians(config.half_deg))


def _nothing(*_: Any) -> Any:
    return Detection((), "blind")


TYPES = [
    SensorType("cone", ConeConfig, (".csv",), _nothing, _nothing, sees=_sees),
    SensorType("sector", SectorConfig, (".csv",), _nothing, _nothing, sees=_sees, flat=True),
]


@pytest.fixture
def cones() -> tuple[Rig, Registry]:
    """Two cones and a level sector that look along x."""

    @hookimpl
    def rigcal_sensor_types() -> list[SensorType]:
        return TYPES

    registry = Registry([SimpleNamespace(rigcal_sensor_types=rigcal_sensor_types)])
    board = {"type": "checkerboard", "columns": 7, "rows": 5, "square_size_m": 0.1}
    sensors = {
        "ahead": {"type": "cone"},
        "beside": {"type": "cone", "pose": {"parent": "ahead", "translation_m": [0, 0.2, 0]}},
        "level": {"type": "sector", "half_deg": 50.0, "pose": {"parent": "ahead"}},
    }
    rig = {"version": 1, "root": "ahead", "targets": {"board": board}, "sensors": sensors}
    return parse_rig(rig, registry), registry


def sample(rig: Rig, registry: Registry, poses: int, **sections: Any) -> BoardPoses:
    board = {"mode": "cover", "poses": poses, "distance_m": [1.0, 4.0]}
    scenario = ScenarioConfig.model_validate({"board": board, "floor_m": -5.0, **sections})
    target = build_targets(rig, registry)["board"]
    return sample_board_poses(rig, registry, target, scenario, seed=3)


def coverage(rig: Rig, registry: Registry, T_w_t: Array) -> dict[str, Array]:
    """By sensor: how many boards were shown at each of its directions and distances."""
    scenario = ScenarioConfig.model_validate({"board": {"mode": "cover", "distance_m": [1, 4]}})
    target = build_targets(rig, registry)["board"]
    T_w_s = sensor_poses(rig, scenario)
    shown = Coverage(scenario.board, rig, registry, target, T_w_s)  # type: ignore[arg-type]
    for T in T_w_t:
        shown.add(spots_in_view(rig, registry, target, T, T_w_s))
    return shown.counts


def test_the_views_of_all_sensors_are_covered_near_and_far(cones: tuple[Rig, Registry]) -> None:
    rig, registry = cones
    counts = coverage(rig, registry, sample(rig, registry, 60).T_w_t)
    for name, shown in counts.items():
        assert np.mean(shown.any(axis=1)) > 0.9, name
        assert np.mean(shown > 0) > 0.5, name
        assert np.all(shown.sum(axis=0) > 15), name


def test_the_borders_of_a_view_are_covered_too(cones: tuple[Rig, Registry]) -> None:
    rig, registry = cones
    T_w_t = sample(rig, registry, 60).T_w_t
    target = build_targets(rig, registry)["board"]
    angles = []
    for T in T_w_t:
        spots = spots_in_view(rig, registry, target, T, {n: np.eye(4) for n in rig.sensors})
        if "ahead" in spots:
            p = spots["ahead"]
            angles.append(np.degrees(np.arccos(p[:, 0] / np.linalg.norm(p, axis=1))))
    angle = np.concatenate(angles)
    assert angle.max() > 38
    assert np.mean(angle > 28) > 0.3


def test_it_covers_more_than_as_many_poses_at_random(cones: tuple[Rig, Registry]) -> None:
    rig, registry = cones
    board = {"bearings_deg": [-30, -15, 0, 15, 30], "radii_m": [1.3, 2, 3.2], "samples": 2}
    around = sample(rig, registry, 30, board=board)
    covering = sample(rig, registry, 30)
    assert len(around.T_w_t) == len(covering.T_w_t) == 30

    def covered(poses: BoardPoses) -> float:
        counts = coverage(rig, registry, poses.T_w_t)
        return float(np.mean([np.mean(shown > 0) for shown in counts.values()]))

    assert covered(covering) > 1.3 * covered(around)


def test_two_sensors_see_every_pose_and_those_they_do_not_are_counted(
    cones: tuple[Rig, Registry],
) -> None:
    rig, registry = cones
    poses = sample(rig, registry, 20)
    assert all(len(seen) >= 2 for seen in poses.seen_by)
    assert poses.redrawn >= poses.unseen > 0
    kept = sample(
        rig,
        registry,
        20,
        redraw=False,
        board={"bearings_deg": [0, 90, 180], "radii_m": [2.0], "samples": 4},
    )
    assert kept.redrawn == 0
    few = [k for k, seen in enumerate(kept.seen_by) if len(seen) < 2]
    assert few[-4:] == [8, 9, 10, 11]
    assert kept.unseen == len(few)


def test_the_same_seed_gives_the_same_poses(cones: tuple[Rig, Registry]) -> None:
    first, again = (sample(*cones, 5).T_w_t for _ in range(2))
    np.testing.assert_array_equal(first, again)


def test_directions_are_spread_from_the_border_inwards() -> None:
    angle = np.radians(np.arange(-60, 61))
    arc = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    chosen = np.degrees(np.arctan2(*spread(arc, 5).T[1::-1]))
    np.testing.assert_allclose(sorted(chosen), [-60, -30, 0, 30, 60], atol=1.5)
    assert abs(abs(chosen[0]) - 60) < 1e-9


def test_a_flat_sensor_sees_what_crosses_its_plane(cones: tuple[Rig, Registry]) -> None:
    rig, registry = cones
    target = build_targets(rig, registry)["board"]

    def seen(height: float, y: float = 0.0) -> bool:
        R = np.column_stack([[0, -1.0, 0], [0, 0, 1.0], [-1.0, 0, 0]])
        T_w_t = se3.transform(R, np.array([2.0, y, height]))
        T_w_s = {name: np.eye(4) for name in rig.sensors}
        return "level" in spots_in_view(rig, registry, target, T_w_t, T_w_s)

    half = target.size[1] / 2
    assert seen(0.0)
    assert seen(half - 0.01)
    assert not seen(half + 0.01)
    assert not seen(0.0, y=7.0)
