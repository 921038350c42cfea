"""A board carried from place to place and held still: from messages to a tree of transforms."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from rigcal import Registry, calibrate, detect, evaluate, load_calibration, load_rig, look_again
from rigcal.errors import RecordingError
from rigcal_sim.dataset import simulate
from rigcal_sim.scenario_file import load_scenario

EXAMPLES = Path(__file__).parents[3] / "examples"
REGISTRY = Registry.from_entry_points()


@pytest.fixture(scope="module")
def rig():
    return load_rig(EXAMPLES / "trolley.yaml", REGISTRY)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory, rig):
    out = tmp_path_factory.mktemp("recorded")
    scenario = load_scenario(EXAMPLES / "trolley_scenario.yaml", rig, REGISTRY)
    simulate(rig, REGISTRY, scenario, 1, out, jobs=1)
    return out


@pytest.fixture(scope="module")
def truth(recorded):
    return load_calibration(recorded / "truth.yaml")


@pytest.fixture(scope="module")
def holds(recorded):
    return yaml.safe_load((recorded / "truth.yaml").read_text())["holds"]


@pytest.fixture(scope="module")
def observations(rig, recorded):
    return detect(rig, REGISTRY, recorded / "recording.mcap", jobs=1)


@pytest.fixture(scope="module")
def calibration(rig, observations):
    return calibrate(rig, REGISTRY, observations)


def hold_of(o, holds):
    inside = [k for k, h in holds.items() if h["start_ns"] <= o.stamp_ns <= h["end_ns"]]
    return inside[0] if inside else None


def test_every_hold_is_one_exposure_and_nothing_else_is(observations, holds):
    seen = [o for o in observations if o.candidates]
    found = {
        o.exposure: {hold_of(p, holds) for p in seen if p.exposure == o.exposure} for o in seen
    }
    assert sorted(map(list, found.values())) == [[k] for k in holds]
    for sensor in ("cam", "scan", "lidar"):
        assert sum(o.sensor == sensor for o in seen) == len(holds), sensor


def test_several_frames_are_combined_and_those_in_motion_left_out(observations):
    for o in observations:
        assert o.candidates or o.exposure == "in motion", o.reason
        assert len(o.frames) >= 3, (o.sensor, o.exposure)
    assert {o.sensor for o in observations if not o.candidates} == {"cam", "scan", "lidar"}


def test_the_truth_is_found(calibration, truth):
    assert calibration.provenance["association"] == "still"
    errors = evaluate(calibration, truth)
    for name, limit_m, limit_deg in (("cam", 0.006, 0.2), ("scan", 0.015, 0.6)):
        assert errors.sensors[name].translation_m < limit_m, name
        assert np.degrees(errors.sensors[name].rotation_rad) < limit_deg, name
        assert errors.sensors[name].nees < 25, name


def test_a_second_look_finds_what_was_missed(rig, recorded, observations, calibration, truth):
    def missed(o):
        return o.candidates and o.exposure in ("0002", "0005") and o.sensor != "lidar"

    worse = [replace(o, candidates=(), reason="missed") if missed(o) else o for o in observations]
    again = look_again(rig, REGISTRY, recorded / "recording.mcap", worse, calibration, jobs=1)
    for o, first, second in zip(observations, worse, again, strict=True):
        if not missed(o):
            assert second is first
            continue
        assert len(second.candidates) == 1, (o.sensor, o.exposure)
        assert second.frames == o.frames
    errors = evaluate(calibrate(rig, REGISTRY, again), truth)
    assert errors.sensors["cam"].translation_m < 0.006


def test_a_board_that_is_never_held_so_long_is_an_error_where_the_rig_says_still(rig, recorded):
    scan = {"scan": rig.sensors["scan"]}
    patient = replace(rig, root="scan", sensors=scan, association="still", hold_s=30.0)
    with pytest.raises(RecordingError, match="nowhere held still for 30 s"):
        detect(patient, REGISTRY, recorded / "recording.mcap", jobs=1)
