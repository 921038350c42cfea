"""A bent board beside the poses: its curvatures are found where the data tell, else refused."""

from dataclasses import replace

import numpy as np
import pytest

import rigcal_camera
import rigcal_lrf2d
from rigcal.calibration_file import load_calibration, save_calibration
from rigcal.errors import ConfigError, NotDeterminedError, ObservationError
from rigcal.estimation import calibrate
from rigcal.geometry import se3
from rigcal.plugin import hookimpl
from rigcal.plugin.registry import Registry
from rigcal.report.sensor_errors import errors_by_sensor
from rigcal.rig import parse_rig

ALL = ("lidar", "left", "right", "scan")
NAMES = ("bend_x", "bend_y", "bend_xy")
BEND = (0.0167, -0.01, 0.006)  # 3 mm at the sides, -1 mm above and below, up to 3.6 mm at a corner
ASKED = {"board": {"refine": ["bend"]}}
SEEDS = range(4)


def curvatures(result):
    numbers = result.refined_targets["board"]
    assert tuple(numbers) == NAMES
    return np.array([numbers[n].value for n in NAMES]), np.array([numbers[n].sigma for n in NAMES])


def off(result, cart):
    """How far the sensors are from the truth: squared, in sigmas; and in metres."""
    squares, metres = [], []
    for name in ALL[1:]:
        sensor = result.sensors[name]
        D = se3.inverse(sensor.T_parent_sensor) @ cart.truth[name]
        e = se3.log(D)
        squares.append(e @ np.linalg.solve(sensor.covariance, e))
        metres.append(np.linalg.norm(D[:3, 3]))
    return np.array(squares), np.array(metres)


@pytest.fixture(scope="module")
def recordings(cart, make_boards):
    found = []
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        found.append(cart.record(rng, make_boards(rng), ALL, bend=BEND))
    return found


@pytest.fixture(scope="module")
def refined(cart, recordings):
    return [calibrate(cart.rig(ALL, ASKED), cart.registry, seen) for seen in recordings]


def test_the_bend_is_found(refined):
    squares = []
    for result in refined:
        values, sigmas = curvatures(result)
        assert np.all(np.abs(values - BEND) < 3 * sigmas)
        assert np.all(sigmas < 0.0015)  # 0.3 mm of height at the sides
        squares += [*((values - BEND) / sigmas) ** 2]
    # The curvatures hardly depend on each other: chi-square of 12, 99 %.
    assert 3.07 < sum(squares) < 28.3


def test_the_poses_beside_it_are_as_good_as_they_say(refined, cart):
    squares = np.array([off(result, cart)[0] for result in refined])
    assert squares.mean() == pytest.approx(6, abs=2)
    assert refined[0].sensors["left"].noise_scale == pytest.approx(1.0, rel=0.1)
    rms = {name: sensor.residual.rms for name, sensor in refined[0].sensors.items()}
    assert rms["left"] == pytest.approx(0.2, rel=0.06)
    assert [rms["lidar"], rms["scan"]] == pytest.approx([0.01, 0.01], rel=0.06)


def test_the_poses_are_better_than_with_a_board_taken_for_flat(refined, cart, recordings):
    ignored = [calibrate(cart.rig(ALL), cart.registry, seen) for seen in recordings]
    with_bend, without = (
        np.sqrt(np.mean([off(result, cart)[1] ** 2 for result in results]))
        for results in (refined, ignored)
    )
    assert with_bend < 0.9 * without
    assert all(r.sensors["left"].residual.rms > 0.205 for r in ignored)


def test_a_flat_board_is_found_to_be_flat(cart, make_boards):
    rng = np.random.default_rng(10)
    result = calibrate(
        cart.rig(ALL, ASKED), cart.registry, cart.record(rng, make_boards(rng), ALL, bend=(0, 0, 0))
    )
    values, sigmas = curvatures(result)
    assert np.all(np.abs(values) < 3 * sigmas)
    assert off(result, cart)[0].max() < 22.5


def test_the_bend_is_found_beside_lens_scale_and_bias(cart, make_boards):
    rng = np.random.default_rng(11)
    printed = {"tag_size_m": 0.2 * 1.005, "tag_gap_m": 0.06 * 1.005}
    truth = {"board": printed, "scan": {"range_bias_m": 0.03}, "lidar": {"range_bias_m": -0.02}}
    seen = cart.record(rng, make_boards(rng, 40), ALL, truth, bend=BEND)
    asked = {
        "board": {"refine": ["scale", "bend"]},
        "left": {"refine": ["lens"]},
        "scan": {"refine": ["range_bias"]},
        "lidar": {"refine": ["range_bias"], "beam_origin": "unknown"},
    }
    result = calibrate(cart.rig(ALL, asked), cart.registry, seen)
    values, sigmas = curvatures_beside(result)
    assert np.all(np.abs(values - BEND) < 3 * sigmas)
    for number, true in (
        (result.refined_targets["board"]["scale"], 1.005),
        (result.sensors["scan"].refined["range_bias_m"], 0.03),
        (result.sensors["lidar"].refined["range_bias_m"], -0.02),
    ):
        assert abs(number.value - true) < 3 * number.sigma
    assert off(result, cart)[0].max() < 22.5


def curvatures_beside(result):
    board = {n: v for n, v in result.refined_targets["board"].items() if n != "scale"}
    return curvatures(replace(result, refined_targets={"board": board}))


def test_the_file_and_the_report_know_the_bend(refined, cart, recordings, tmp_path):
    save_calibration(tmp_path / "calibration.yaml", refined[0])
    read = load_calibration(tmp_path / "calibration.yaml")
    assert read.refined_targets == refined[0].refined_targets
    assert read.refined_targets["board"]["bend_x"].unit == "1/m"
    rig = cart.rig(ALL, ASKED)
    found = errors_by_sensor(read, recordings[0], rig, cart.registry)
    for name in ALL:
        errors, result = found[name], refined[0].sensors[name]
        rms = np.sqrt(np.mean(errors.errors**2))
        assert rms == pytest.approx(result.residual.rms, rel=0.02), name
        scale = np.sqrt(np.mean(errors.whitened**2)) / result.noise_scale
        assert 0.7 < scale < 1.1, name


def test_a_bend_that_nobody_can_see_is_refused(cart, make_boards):
    rng = np.random.default_rng(12)
    noisy = {"scan": {"sigma_m": 0.03}}
    seen = cart.record(rng, make_boards(rng, 16, 30.0, (5.0, 9.0), 0.1), ("left", "scan"), noisy)
    rig = cart.rig(("left", "scan"), ASKED | noisy)
    with pytest.raises(NotDeterminedError, match=r"board: bend: leaves .* mm of height .*bend_"):
        calibrate(rig, cart.registry, seen)


def test_exposures_in_which_nobody_sees_the_board_the_right_way_up_are_named(cart, recordings):
    """Nobody from the start, or nobody that is left: pixels of exposure 7 are anywhere."""
    rng = np.random.default_rng(0)

    def spoilt(o):
        if o.sensor not in ("left", "right") or not o.candidates:
            return o
        if o.exposure in ("3", "5"):
            return replace(o, candidates=(), reason="covered")
        measured = dict(o.candidates[0].measurement)
        measured["uv"] = measured["uv"] + rng.normal(0, 40, measured["uv"].shape)
        wrong = replace(o.candidates[0], measurement=measured)
        return replace(o, candidates=(wrong,)) if o.exposure == "7" else o

    seen = [spoilt(o) for o in recordings[0]]
    result = calibrate(cart.rig(ALL, ASKED), cart.registry, seen)
    reasons = {(r.sensor, r.exposure): r.reason for r in result.rejected}
    for sensor, exposure in (("lidar", "3"), ("scan", "5"), ("lidar", "7"), ("scan", "7")):
        assert "how the board is turned" in reasons[sensor, exposure]
    assert "how the board is turned" not in reasons["left", "7"]


def test_a_flat_board_beside_a_bent_one_needs_no_camera(cart, recordings):
    """The lasers look at a board of their own; the left camera hangs from the lidar as given."""
    content = cart.content(ALL, ASKED)
    board = content["targets"]["board"]
    content["targets"]["plain"] = {k: v for k, v in board.items() if k != "refine"}
    for name, entry in content["sensors"].items():
        looks_at = "plain" if name in ("lidar", "scan") else "board"
        content["sensors"][name] = entry | {"target": looks_at, "fixed": name == "left"}
    rig = parse_rig(content, cart.registry)
    result = calibrate(rig, cart.registry, recordings[0])
    assert result.sensors["scan"].inliers > 15
    assert not [r for r in result.rejected if "how the board is turned" in r.reason]


def test_sensors_that_cannot_tell_a_bend_are_named(cart):
    class Plugin:
        @hookimpl
        def rigcal_sensor_types(self):
            return [replace(cart.registry.sensor_type("lrf3d"), bends=False)]

    registry = Registry([Plugin(), rigcal_camera, rigcal_lrf2d])
    with pytest.raises(
        ConfigError, match=r"targets\.board\.refine.*lidar cannot tell a bent board .*type lrf3d"
    ):
        replace(cart, registry=registry).rig(ALL, ASKED)
    with pytest.raises(ConfigError, match=r"refine\[1\]: 'bend' stands twice"):
        cart.rig(ALL, {"board": {"refine": ["bend", "bend"]}})


def test_what_was_made_by_hand_has_no_bend(cart, recordings):
    by_hand = [
        replace(
            o,
            candidates=tuple(
                replace(c, measurement={"by_hand": np.array(True)}) for c in o.candidates
            ),
        )
        for o in recordings[0]
    ]
    with pytest.raises(ObservationError, match=r"take `bend` out of `targets\.board\.refine`"):
        calibrate(cart.rig(ALL, ASKED), cart.registry, by_hand)
