"""Transforms and covariances between any two sensors of a calibration."""

import numpy as np
import pytest

from rigcal.calibration import Calibration, JointCovariance, SensorResult
from rigcal.calibration_file import load_calibration, save_calibration
from rigcal.errors import ConfigError
from rigcal.geometry import se3


@pytest.fixture
def calibration():
    """Three sensors, of which two move together."""
    rng = np.random.default_rng(0)
    A = rng.normal(size=(12, 12)) * 1e-3
    joint = A @ A.T
    poses = {name: se3.exp(rng.normal(0, 0.5, 6)) for name in ("a", "b")}
    sensors = {"root": SensorResult("root", np.eye(4))}
    for i, (name, T) in enumerate(poses.items()):
        part = slice(6 * i, 6 * i + 6)
        sigma = np.sqrt(np.diagonal(joint[part, part]))
        sigmas = {"configured": sigma / 2, "estimated": sigma}
        sensors[name] = SensorResult("root", T, joint[part, part], sigmas=sigmas)
    return Calibration("root", sensors, joint_covariance=JointCovariance(("a", "b"), joint))


def test_covariance_to_and_from_the_root(calibration):
    own = calibration.sensors["a"].covariance
    np.testing.assert_allclose(calibration.covariance("root", "a"), own, rtol=1e-12)
    # Seen the other way round, the same motion is about the root's axes.
    A = se3.adjoint(calibration.T("root", "a"))
    np.testing.assert_allclose(calibration.covariance("a", "root"), A @ own @ A.T, rtol=1e-9)


def test_covariance_between_two_sensors_is_their_scatter(calibration):
    rng = np.random.default_rng(1)
    joint = calibration.joint_covariance.matrix
    xi = rng.multivariate_normal(np.zeros(12), joint, size=40000)
    moved = [calibration.T("root", n) @ se3.exp(xi[:, i : i + 6]) for n, i in (("a", 0), ("b", 6))]
    off = se3.log(se3.inverse(calibration.T("a", "b")) @ se3.inverse(moved[0]) @ moved[1])
    expected = calibration.covariance("a", "b")
    scale = np.sqrt(np.outer(np.diagonal(expected), np.diagonal(expected)))
    np.testing.assert_allclose(off.T @ off / len(off) / scale, expected / scale, atol=0.03)


def test_covariances_and_sigmas_survive_the_file(calibration, tmp_path):
    save_calibration(tmp_path / "calibration.yaml", calibration)
    read = load_calibration(tmp_path / "calibration.yaml")
    joint = calibration.joint_covariance
    assert read.joint_covariance.sensors == joint.sensors
    np.testing.assert_array_equal(read.joint_covariance.matrix, joint.matrix)
    for how in ("configured", "estimated"):
        np.testing.assert_array_equal(
            read.sensors["b"].sigmas[how], calibration.sensors["b"].sigmas[how]
        )


def test_a_misspelt_sensor_is_told_the_nearest(calibration):
    with pytest.raises(ConfigError, match=r"no sensor 'rot', did you mean 'root'\? \(has: root, a"):
        calibration.T("a", "rot")


def test_pose_between_sensors_that_nothing_connects_is_an_error(calibration):
    with pytest.raises(ConfigError, match=r"no sensor 'gps' \(has: root, a, b\)"):
        calibration.T("a", "gps")
    circle = {"a": SensorResult("b", np.eye(4)), "b": SensorResult("a", np.eye(4))}
    with pytest.raises(ConfigError, match="no way from sensor 'a' to root 'root'"):
        Calibration("root", circle).T("root", "a")


def test_without_a_joint_covariance_it_says_so(calibration):
    alone = Calibration("root", calibration.sensors)
    with pytest.raises(ConfigError, match="no covariance between sensors"):
        alone.covariance("a", "b")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("sensors: [a, b]", "sensors: [a, c]"), "joint_covariance.sensors: no sensor 'c'"),
        (("sensors: [a, b]", "sensors: [a]"), "expected 6 rows of 6 numbers, six for each"),
    ],
)
def test_a_joint_covariance_that_does_not_fit_is_refused(calibration, tmp_path, change, message):
    path = tmp_path / "calibration.yaml"
    save_calibration(path, calibration)
    path.write_text(path.read_text().replace(*change))
    with pytest.raises(ConfigError, match=message):
        load_calibration(path)
