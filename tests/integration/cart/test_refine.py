"""Lens, board and ranges estimated beside the poses: found where the data tell, else refused."""

from dataclasses import replace

import numpy as np
import pytest

import rigcal_camera
import rigcal_lrf3d
from rigcal.calibration_file import load_calibration, save_calibration
from rigcal.calibration_text import calibration_text
from rigcal.errors import ConfigError, NotDeterminedError
from rigcal.estimation import calibrate
from rigcal.geometry import se3
from rigcal.graph.method import Method
from rigcal.plugin import SensorType, hookimpl
from rigcal.plugin.registry import Registry

NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")
TRUE_LENS = (600.0, 602.0, 615.5, 511.5, -0.1, 0.02, 0.001, -0.0005)
WRONG_LENS = {
    "focal_px": [606.0, 598.0],
    "principal_px": [618.0, 509.0],
    "distortion": [-0.11, 0.025, 0.0, 0.0],
}
LENS = {"left": {"refine": ["lens"]}}
ALL = ("lidar", "left", "right", "scan")


def sigmas_off(number, truth):
    return (number.value - truth) / number.sigma


@pytest.fixture(scope="module")
def refined(cart, make_boards):
    """Lens of a camera from a wrong one, a board printed 0.5 % too large, a bias of 30 mm."""
    rng = np.random.default_rng(0)
    printed = {"tag_size_m": 0.2 * 1.005, "tag_gap_m": 0.06 * 1.005}
    truth = {"board": printed, "scan": {"range_bias_m": 0.03}}
    seen = cart.record(rng, make_boards(rng), ALL, truth)
    asked = {"left": WRONG_LENS | LENS["left"], "board": {"refine": ["scale"]}}
    rig = cart.rig(ALL, asked | {"scan": {"refine": ["range_bias"]}})
    return calibrate(rig, cart.registry, seen)


def test_the_lens_is_found(refined):
    numbers = refined.sensors["left"].refined
    assert tuple(numbers) == NAMES
    assert max(abs(sigmas_off(numbers[n], v)) for n, v in zip(NAMES, TRUE_LENS, strict=True)) < 3
    assert numbers["fx"].start == 606.0
    assert numbers["fx"].sigma < 0.3
    assert numbers["fx"].unit == "px"


def test_the_scale_of_the_print_is_found(refined):
    scale = refined.refined_targets["board"]["scale"]
    assert abs(sigmas_off(scale, 1.005)) < 3
    assert scale.sigma < 0.0005


def test_the_bias_of_a_lasers_ranges_is_found(refined):
    bias = refined.sensors["scan"].refined["range_bias_m"]
    assert abs(sigmas_off(bias, 0.03)) < 3
    assert bias.sigma < 0.003


def test_the_poses_beside_them_are_as_good_as_they_say(refined, cart):
    for name in ("left", "right", "scan"):
        sensor = refined.sensors[name]
        e = se3.log(se3.inverse(sensor.T_parent_sensor) @ cart.truth[name])
        assert e @ np.linalg.solve(sensor.covariance, e) < 22.5, name  # chi-square of 6, 99.9 %
    # Residuals are those of the lens and the board as found.
    assert refined.sensors["left"].residual.rms == pytest.approx(0.2, rel=0.1)
    assert refined.sensors["left"].noise_scale == pytest.approx(1.0, rel=0.1)


def test_what_was_refined_survives_the_file(refined, tmp_path):
    save_calibration(tmp_path / "calibration.yaml", refined)
    read = load_calibration(tmp_path / "calibration.yaml")
    assert read.sensors["left"].refined == refined.sensors["left"].refined
    assert read.refined_targets == refined.refined_targets
    assert "refined" not in calibration_text(
        replace(refined, sensors={"lidar": refined.sensors["lidar"]}, refined_targets={})
    )


def test_the_bias_of_a_3d_laser_is_found_wherever_its_beams_start(cart, make_boards):
    rng = np.random.default_rng(1)
    boards = make_boards(rng)
    seen = cart.record(rng, boards, ("lidar", "left", "right"), {"lidar": {"range_bias_m": 0.03}})
    for origin in ("sensor", "unknown"):
        asked = {"lidar": {"refine": ["range_bias"], "beam_origin": origin}}
        result = calibrate(cart.rig(("lidar", "left", "right"), asked), cart.registry, seen)
        bias = result.sensors["lidar"].refined["range_bias_m"]
        assert abs(sigmas_off(bias, 0.03)) < 3, origin
        assert bias.sigma < 0.002, origin


@pytest.fixture(scope="module")
def middle(cart, make_boards):
    """Boards straight ahead and far away: in the middle of every view."""
    rng = np.random.default_rng(2)
    return cart.record(rng, make_boards(rng, 16, 3.0, (3.5, 4.5)), ALL)


def of(observations, *sensors):
    return [o for o in observations if o.sensor in sensors]


def test_distortion_from_the_middle_of_the_view_is_refused(cart, middle):
    rig = cart.rig(("left", "right"), LENS)
    with pytest.raises(NotDeterminedError, match=r"left: lens: .*least known: .*k2 \(\+-"):
        calibrate(rig, cart.registry, of(middle, "left", "right"))


def test_scale_from_cameras_alone_is_refused(cart, make_boards):
    rng = np.random.default_rng(3)
    seen = cart.record(rng, make_boards(rng, 12), ("left", "right"))
    rig = cart.rig(("left", "right"), {"board": {"refine": ["scale"]}})
    with pytest.raises(NotDeterminedError, match=r"board: scale: .*far more.*scale \(open\)"):
        calibrate(rig, cart.registry, seen)


def test_bias_from_boards_in_one_direction_is_refused(cart, make_boards):
    rng = np.random.default_rng(4)
    ahead = cart.record(rng, make_boards(rng, 12, 3.0, (2.4, 2.6)), ("lidar", "left", "scan"))
    rig = cart.rig(("lidar", "left", "scan"), {"scan": {"refine": ["range_bias"]}})
    with pytest.raises(NotDeterminedError, match=r"scan: range_bias: .*range_bias_m \(\+-.* m\)"):
        calibrate(rig, cart.registry, ahead)


def test_what_is_known_beforehand_counts(cart, middle):
    """A lens that the boards leave open is fine where its plugin knows its numbers well."""
    own = rigcal_camera.CAMERA.refinable["lens"]

    def known(config):
        parameters = own.parameters(config)
        return replace(parameters, prior_sigma=np.array([1.0] * 4 + [1e-3] * 4))

    camera: SensorType = replace(
        rigcal_camera.CAMERA, refinable={"lens": replace(own, parameters=known)}
    )

    class Plugin:
        @hookimpl
        def rigcal_sensor_types(self):
            return [camera]

    registry = Registry([Plugin(), rigcal_lrf3d])
    result = calibrate(cart.rig(("left", "right"), LENS), registry, of(middle, "left", "right"))
    numbers = result.sensors["left"].refined
    for name, truth, most in zip(NAMES, TRUE_LENS, [1.0] * 4 + [1e-3] * 4, strict=True):
        assert numbers[name].sigma <= most
        assert abs(numbers[name].value - truth) < 3 * most


def test_the_graph_of_msgcal_refines_nothing(cart, middle):
    rig = cart.rig(("left", "right"), LENS)
    with pytest.raises(ConfigError, match=r"msgcal estimates poses only: take `refine` out"):
        calibrate(
            rig, cart.registry, of(middle, "left", "right"), method=Method(formulation="msgcal")
        )


def test_only_what_the_type_offers_can_be_asked_for(cart):
    with pytest.raises(ConfigError, match=r"refine\[0\]: camera does not offer 'lense', did you"):
        cart.rig(("lidar", "left"), {"left": {"refine": ["lense"]}})
    with pytest.raises(ConfigError, match=r"refine\[1\]: 'lens' stands twice"):
        cart.rig(("lidar", "left"), {"left": {"refine": ["lens", "lens"]}})
