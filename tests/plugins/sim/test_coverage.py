from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from rigcal.errors import ConfigError
from rigcal.plugin import Registry
from rigcal.rig import Rig, build_targets
from rigcal_sim.coverage import default_scenario
from rigcal_sim.poses import sample_board_poses

MakeRig = Callable[..., Rig]


def test_without_a_scenario_the_board_is_shown_where_two_sensors_look(
    make_rig: MakeRig, registry: Registry
) -> None:
    rig = make_rig()
    target = build_targets(rig, registry)["board"]
    scenario = default_scenario(rig, registry, target)
    # a sees -90 to 90 degrees, b -70 to 110.
    assert min(scenario.board.bearings_deg) in (-75, -60)
    assert max(scenario.board.bearings_deg) == 90
    assert min(scenario.board.radii_m) >= np.hypot(0.8, 0.6)
    poses = sample_board_poses(rig, registry, target, scenario, seed=0)
    assert 30 <= len(poses.T_w_t) <= 60


def test_radii_stay_within_reach(make_rig: MakeRig, registry: Registry) -> None:
    rig = make_rig(range_max_m=1.7)
    target = build_targets(rig, registry)["board"]
    assert default_scenario(rig, registry, target).board.radii_m == (1.5,)


def test_sensors_that_look_apart_have_no_scenario(make_rig: MakeRig, registry: Registry) -> None:
    rig = make_rig(pose={"parent": "a", "rpy_deg": [0, 0, 180], "translation_m": [-0.1, 0, 0]})
    target = build_targets(rig, registry)["board"]
    with pytest.raises(ConfigError, match=r"no two sensors of rig .* or give a scenario file"):
        default_scenario(rig, registry, target)
