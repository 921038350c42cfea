"""When the sensors look, and what their clocks say."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from rigcal.errors import ConfigError
from rigcal.plugin import Registry
from rigcal.rig import Rig
from rigcal_sim.carry import carry
from rigcal_sim.plan import Plan, Shot, plan_shots
from rigcal_sim.poses import board_pose
from rigcal_sim.scenario import ScenarioConfig
from rigcal_sim.scenario_file import sensor_effects

MakeRig = Callable[..., Rig]
POSES = np.array([board_pose(b, 2.0, 0.0, np.zeros(3)) for b in (0.0, 30.0, 60.0)])
CONTINUOUS = {"mode": "continuous", "hold_s": 1.0}


def make_plan(rig: Rig, registry: Registry, **sections: Any) -> tuple[Plan, ScenarioConfig]:
    stamps = {"start_s": 100.0, "jitter_s": 0.002}
    board = {"bearings_deg": [0], "radii_m": [2]}
    scenario = ScenarioConfig.model_validate({"board": board, "stamps": stamps, **sections})
    effects = sensor_effects(scenario, rig, registry)
    return plan_shots(rig, scenario, effects, POSES, seed=1), scenario


def of(plan: Plan, sensor: str) -> list[Shot]:
    return [shot for shot in plan.shots if shot.sensor == sensor]


def test_sensors_of_a_continuous_recording_run_at_their_own_rates_and_phases(
    make_rig: MakeRig, registry: Registry
) -> None:
    sensors = {
        "a": {"rate_hz": 20.0},
        "b": {"rate_hz": 5.0, "phase_s": 0.03, "clock_offset_s": 0.5, "jitter_s": 0.0},
    }
    plan, scenario = make_plan(make_rig(), registry, recording=CONTINUOUS, sensors=sensors)
    carrying = carry(POSES, scenario.recording, seed=1)  # type: ignore[arg-type]
    a, b = of(plan, "a"), of(plan, "b")
    assert len(a) == int(np.ceil(carrying.end_s * 20))
    times = np.arange(len(b)) / 5 + 0.03
    np.testing.assert_allclose([s.stamp_ns for s in b], 1e9 * (100.5 + times), atol=2)
    # The clock is late, the board is where it was at the true time.
    np.testing.assert_allclose([s.T_w_t for s in b], carrying.at(times)[0], atol=1e-12)
    late = np.array([s.stamp_ns for s in a]) / 1e9 - 100 - np.arange(len(a)) / 20
    assert 0.001 < np.abs(late).max() <= 0.002 + 1e-6
    assert [s.number for s in a] == list(range(len(a)))


def test_shots_are_in_the_order_of_their_stamps(make_rig: MakeRig, registry: Registry) -> None:
    plan, _ = make_plan(
        make_rig(), registry, recording=CONTINUOUS, defaults={"ranger": {"rate_hz": 30.0}}
    )
    assert all(first.stamp_ns <= second.stamp_ns for first, second in pairwise(plan.shots))


def test_holds_are_when_the_board_stands_at_the_poses(
    make_rig: MakeRig, registry: Registry
) -> None:
    plan, _ = make_plan(
        make_rig(), registry, recording=CONTINUOUS, defaults={"ranger": {"rate_hz": 50.0}}
    )
    assert [end - start for start, end in plan.holds] == [10**9] * 3
    still = [np.array_equal(s.T_w_t, POSES[s.exposure]) for s in plan.shots]
    held = [
        any(start + 3e6 < s.stamp_ns < end - 3e6 for start, end in plan.holds) for s in plan.shots
    ]
    assert all(s for s, h in zip(still, held, strict=True) if h)
    assert 0 < sum(still) < len(still)


def test_one_frame_per_pose_lies_in_the_middle_of_its_hold(
    make_rig: MakeRig, registry: Registry
) -> None:
    plan, _ = make_plan(make_rig(), registry)
    assert len(plan.shots) == 6
    for shot in plan.shots:
        start, end = plan.holds[shot.exposure]
        assert abs(shot.stamp_ns - (start + end) / 2) <= 2e6
        np.testing.assert_array_equal(shot.T_w_t, POSES[shot.exposure])


def test_a_rate_that_is_missing_is_asked_for(make_rig: MakeRig, registry: Registry) -> None:
    with pytest.raises(ConfigError, match=r"sensors.b: a continuous recording needs the rate"):
        make_plan(make_rig(), registry, recording=CONTINUOUS, sensors={"a": {"rate_hz": 5}})


def test_jitter_must_not_mix_up_a_sensors_frames(make_rig: MakeRig, registry: Registry) -> None:
    sensors = {"a": {"rate_hz": 5.0}, "b": {"rate_hz": 100.0, "jitter_s": 0.005}}
    with pytest.raises(ConfigError, match=r"sensors.b.jitter_s: 0.005 mixes up frames 0.01 s"):
        make_plan(make_rig(), registry, recording=CONTINUOUS, sensors=sensors)
