"""What a recording determines, in words: good ones, and poor ones that are withheld."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from rigcal.calibration_file import load_calibration
from rigcal.errors import NotConnectedError, NotDeterminedError
from rigcal.estimation import calibrate
from rigcal.geometry import se3
from rigcal.graph.method import Method
from rigcal.observation_file import save_observations

UPRIGHT = (0.0, 0.0, 0.6)
"""Tilts of boards that are turned about the vertical only."""


def withheld(cart, observations, sensors, **changes):
    with pytest.raises(NotDeterminedError) as error:
        calibrate(cart.rig(sensors, changes), cart.registry, observations)
    return error.value


def of(observations, *sensors):
    return [o for o in observations if o.sensor in sensors]


@pytest.fixture(scope="module")
def good(cart, make_boards):
    rng = np.random.default_rng(10)
    return cart.record(rng, make_boards(rng), ("lidar", "left", "right"))


@pytest.fixture(scope="module")
def upright(cart, make_boards):
    rng = np.random.default_rng(11)
    boards = make_boards(rng, 20, 40.0, (1.2, 3.5), UPRIGHT)
    return cart.record(rng, boards, ("left", "right", "scan"))


def test_a_good_recording_determines_every_pose(cart, good):
    result = calibrate(cart.rig(("lidar", "left", "right")), cart.registry, good)
    assert result.verdict.summary == "All 2 poses are determined."
    assert result.verdict.lines() == [result.verdict.summary]
    assert {axis.state for v in result.verdict.sensors.values() for axis in v.axes} == {
        "determined"
    }


def test_a_level_scan_of_upright_boards_names_its_open_axes(cart, upright):
    error = withheld(cart, of(upright, "left", "scan"), ("left", "scan"))
    verdict = error.verdict.sensors["scan"]
    assert verdict.named("open") == [
        "rotation about x", "rotation about y", "translation along z",
    ]  # fmt: skip
    assert verdict.causes == ("all boards stand at right angles to the plane of its scan",)
    assert "boards that lean towards it" in str(error)


def test_a_root_that_hangs_loosely_is_named_and_not_all_the_others(cart, upright):
    error = withheld(cart, upright, ("scan", "left", "right"))
    assert error.verdict.reference in ("left", "right")
    assert error.verdict.withheld == ("scan",)


def test_parallel_boards_are_told(cart, make_boards):
    rng = np.random.default_rng(12)
    ahead = make_boards(rng, 20, 12.0, (1.5, 3.5), 0.0)
    parallel = [se3.transform(ahead[0][:3, :3], T[:3, 3]) for T in ahead]
    seen = cart.record(rng, parallel, ("lidar", "left"))
    error = withheld(cart, seen, ("left", "lidar"))
    verdict = error.verdict.sensors["lidar"]
    # The lidar's x axis is normal to the boards: they can be shifted in, and turned about it.
    assert verdict.named("open") == [
        "rotation about x", "translation along y", "translation along z",
    ]  # fmt: skip
    assert "all boards are parallel" in verdict.causes
    assert "to record: boards that are tilted in several directions" in str(error)


def test_one_distance_is_told(cart, make_boards):
    rng = np.random.default_rng(13)
    seen = cart.record(rng, make_boards(rng, 20, 5.0, (2.0, 2.05), 0.15), ("lidar", "scan"))
    error = withheld(cart, seen, ("lidar", "scan"))
    verdict = error.verdict.sensors["scan"]
    assert {"rotation about y", "translation along z"} <= set(verdict.named("open"))
    assert any(cause.startswith("all boards stand at one distance") for cause in verdict.causes)
    assert "boards that are nearer and farther" in verdict.advice


def test_groups_that_nothing_links_and_the_pair_that_would(cart, make_boards):
    rng = np.random.default_rng(14)
    first = cart.record(rng, make_boards(rng, 10), ("lidar", "left"))
    both = cart.record(rng, make_boards(rng, 12), ("right", "scan"))
    second = [replace(o, exposure=f"later {o.exposure}") for o in both]
    rig = cart.rig(("lidar", "left", "right", "scan"))
    with pytest.raises(NotConnectedError) as error:
        calibrate(rig, cart.registry, first + second)
    assert error.value.groups == [["left", "lidar"], ["right", "scan"]]
    assert error.value.joins == [("lidar", "right")]
    assert "where lidar and right see it at the same time" in str(error.value)


def test_the_verdict_is_printed_and_written_and_the_result_withheld(
    cart, upright, tmp_path, monkeypatch, command
):
    monkeypatch.chdir(tmp_path)
    rig = cart.content(("left", "scan"))
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(rig))
    save_observations("seen.npz", of(upright, "left", "scan"))
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "calibration.yaml").write_text("of an earlier run")
    arguments = ["calibrate", "rig.yaml", "seen.npz", "--out", "out", "--no-report"]
    ran = command(*arguments)
    assert ran.code == 1
    assert "rigcal: The data do not determine the pose of scan." in ran.err
    assert not (tmp_path / "out" / "calibration.yaml").exists()
    written = yaml.safe_load((tmp_path / "out" / "verdict.yaml").read_text())
    assert written["result"] == "withheld"
    axes = written["sensors"]["scan"]["axes"]
    assert axes["translation_z"] == {"state": "open", "sigma": None}

    ran = command(*arguments, "--accept-weak")
    assert ran.code == 0
    assert "not determined: " in ran.out
    written = yaml.safe_load((tmp_path / "out" / "verdict.yaml").read_text())
    assert written["result"] == "given"
    accepted = load_calibration(tmp_path / "out" / "calibration.yaml").sensors["scan"]
    truth = se3.inverse(cart.truth["left"]) @ cart.truth["scan"]
    off = np.abs(se3.log(se3.inverse(accepted.T_parent_sensor) @ truth))
    # What the boards do fix is right; what they leave open stays near its first value.
    assert off[2] < 0.01
    assert off[3:5].max() < 0.03
    assert off[5] < 0.5
    assert np.sqrt(accepted.covariance[5, 5]) > 0.05


def test_both_sigmas_are_shown_and_the_estimated_ones_are_right(cart, good):
    """A configured noise three times too large makes the configured sigmas so, not the others."""
    changes = {name: {"sigma_px": 0.6} for name in ("left", "right")}
    honest = calibrate(cart.rig(("left", "right")), cart.registry, of(good, "left", "right"))
    wrong = cart.rig(("left", "right"), changes)
    result = calibrate(wrong, cart.registry, of(good, "left", "right"))
    sigmas, expected = result.sensors["right"].sigmas, honest.sensors["right"].sigmas
    np.testing.assert_allclose(sigmas["configured"], 3 * expected["configured"], rtol=0.02)
    np.testing.assert_allclose(sigmas["estimated"], expected["estimated"], rtol=0.05)
    np.testing.assert_allclose(
        np.sqrt(np.diagonal(result.sensors["right"].covariance)), sigmas["estimated"], rtol=0.02
    )


def test_the_covariance_between_any_two_sensors_is_true(cart, make_boards):
    nees = []
    for seed in range(5):
        rng = np.random.default_rng(20 + seed)
        seen = cart.record(rng, make_boards(rng, 10), ("lidar", "left", "right"))
        result = calibrate(cart.rig(("lidar", "left", "right")), cart.registry, seen)
        truth = se3.inverse(cart.truth["left"]) @ cart.truth["right"]
        e = se3.log(se3.inverse(result.T("left", "right")) @ truth)
        covariance = result.covariance("left", "right")
        nees.append(e @ np.linalg.solve(covariance, e))
        # The lidar shakes both alike: between them they are better known than in its frame.
        assert np.trace(covariance) < np.trace(result.sensors["right"].covariance)
    assert 2.3 < np.mean(nees) < 12  # chi-square of 30 degrees of freedom / 5, 99.9 %


def test_msgcal_has_the_same_verdict(cart, good):
    rig = cart.rig(("lidar", "left", "right"))
    result = calibrate(rig, cart.registry, good, method=Method("msgcal"))
    assert result.verdict.summary == "All 2 poses are determined."
