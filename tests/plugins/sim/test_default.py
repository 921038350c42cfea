from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, ClassVar, Literal

import numpy as np
import pytest
import yaml

from rigcal.errors import ConfigError
from rigcal.plugin import Registry, SensorConfig, SensorType, hookimpl
from rigcal.rig import Rig, build_targets, parse_rig
from rigcal_sim.default import default_scenario
from rigcal_sim.sampling import sample_board_poses
from rigcal_sim.scenario import ScenarioConfig

MakeRig = Callable[..., Rig]


def test_without_a_scenario_the_board_is_shown_where_two_sensors_look(
    make_rig: MakeRig, registry: Registry
) -> None:
    rig = make_rig()
    target = build_targets(rig, registry)["board"]
    scenario = default_scenario(rig, registry, target)
    poses = sample_board_poses(rig, registry, target, scenario, seed=0)
    assert set(poses.seen_by) == {("a", "b")}
    assert len(poses.T_w_t) == 40
    # a sees -90 to 90 degrees, b -70 to 110.
    bearings = np.degrees(np.arctan2(poses.T_w_t[:, 1, 3], poses.T_w_t[:, 0, 3]))
    assert -85 < bearings.min() < -40
    assert 60 < bearings.max() < 105
    distances = np.linalg.norm(poses.T_w_t[:, :3, 3], axis=1)
    assert distances.min() < 1.5
    assert distances.max() > 2.2


def test_boards_stay_within_reach(make_rig: MakeRig, registry: Registry) -> None:
    rig = make_rig(range_max_m=1.7)
    target = build_targets(rig, registry)["board"]
    scenario = default_scenario(rig, registry, target)
    poses = sample_board_poses(rig, registry, target, scenario, seed=0)
    assert np.linalg.norm(poses.T_w_t[:, :3, 3], axis=1).max() < 2.0


def test_sensors_that_look_apart_have_no_scenario(make_rig: MakeRig, registry: Registry) -> None:
    rig = make_rig(pose={"parent": "a", "rpy_deg": [0, 0, 180], "translation_m": [-0.1, 0, 0]})
    target = build_targets(rig, registry)["board"]
    with pytest.raises(ConfigError, match=r"no two sensors of rig .* or give a scenario file"):
        default_scenario(rig, registry, target)


def test_a_camera_as_root_that_looks_at_the_sky_is_told_how_to_look_ahead() -> None:
    class EyeConfig(SensorConfig, frozen=True):
        optical: ClassVar[bool] = True
        type: Literal["eye"] = "eye"

    def sees(p_s: Any, config: Any) -> Any:
        return p_s[:, 2] > 0.5 * np.linalg.norm(p_s, axis=1)

    @hookimpl
    def rigcal_sensor_types() -> list[SensorType]:
        unused = lambda *_: None  # noqa: E731
        return [SensorType("eye", EyeConfig, (".none",), unused, unused, sees=sees)]

    registry = Registry([SimpleNamespace(rigcal_sensor_types=rigcal_sensor_types)])
    board = {"type": "checkerboard", "columns": 7, "rows": 5, "square_size_m": 0.1}
    b = {"type": "eye", "pose": {"parent": "a", "translation_m": [0.2, 0.0, 0.0]}}
    rig = parse_rig(
        {"version": 1, "root": "a", "targets": {"board": board},
         "sensors": {"a": {"type": "eye"}, "b": b}}, registry,
    )  # fmt: skip
    target = build_targets(rig, registry)["board"]
    around = {"bearings_deg": [0.0], "radii_m": [2.0], "samples": 2}
    with pytest.raises(ConfigError, match="root 'a' looks along its own z axis, up too: give") as e:
        sample_board_poses(rig, registry, target, ScenarioConfig(board=around), seed=0)
    advised = yaml.safe_load(str(e.value).split("`")[1])
    ahead = ScenarioConfig(board=around, **advised)
    poses = sample_board_poses(rig, registry, target, ahead, seed=0)
    assert poses.seen_by == (("a", "b"),) * 2
