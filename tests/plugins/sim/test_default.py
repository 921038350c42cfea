from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from rigcal.errors import ConfigError
from rigcal.plugin import Registry
from rigcal.rig import Rig, build_targets
from rigcal_sim.default import default_scenario
from rigcal_sim.sampling import sample_board_poses

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
