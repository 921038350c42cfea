"""Which sensor moved, and by how many sigmas."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rigcal
from rigcal.calibration import Calibration, JointCovariance, SensorResult
from rigcal.comparison import LIMIT_SIGMAS, _changes
from rigcal.diagnosis.verdict_file import save_verdict
from rigcal.errors import ConfigError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array

SIGMAS = np.array([0.001, 0.002, 0.001, 0.002, 0.001, 0.003])
POSES = {
    "cam0": se3.exp(np.array([0.3, -1.1, 0.7, 0.2, -0.4, 0.6])),
    "cam1": se3.exp(np.array([-0.9, 0.2, 1.5, 1.2, 0.1, -0.3])),
    "front": se3.exp(np.array([0.1, 0.1, -0.4, -0.7, 0.5, 0.2])),
}
SHIFT = se3.exp(np.array([0.0, 0.02, 0.0, 0.0, 0.0, 0.05]))


def _calibration(poses: Mapping[str, Array], root: str = "lidar") -> Calibration:
    covariance = np.diag(SIGMAS**2)
    sensors = {n: SensorResult(root, T, covariance) for n, T in poses.items()}
    return Calibration(root, {root: SensorResult(root, np.eye(4)), **sensors})


def _noisy(rng: np.random.Generator) -> Calibration:
    return _calibration({n: T @ se3.exp(rng.normal(size=6) * SIGMAS) for n, T in POSES.items()})


def test_sensors_that_stood_still_are_within_their_uncertainty() -> None:
    rng = np.random.default_rng(2)
    pairs = [rigcal.compare(_noisy(rng), _noisy(rng)) for _ in range(150)]
    sigmas = np.array([[c.sigmas for c in p.sensors.values()] for p in pairs], float)
    assert abs(np.mean(sigmas**2) - 1) < 0.08
    assert sum(bool(p.moved) for p in pairs) <= 3  # 450 sensors at 1 in 1000
    assert {p.reference for p in pairs} == {"lidar"}


def test_the_sensor_that_moved_is_named_with_its_motion() -> None:
    rng = np.random.default_rng(3)
    after = _noisy(rng)
    moved = replace(after.sensors["cam1"], T_parent_sensor=POSES["cam1"] @ SHIFT)
    after = replace(after, sensors={**after.sensors, "cam1": moved})
    comparison = rigcal.compare(_calibration(POSES), after)
    assert comparison.moved == ("cam1",)
    change = comparison.sensors["cam1"]
    np.testing.assert_allclose(change.T_before_after, SHIFT, atol=1e-12)
    assert change.translation_m == pytest.approx(np.linalg.norm(SHIFT[:3, 3]))
    assert change.rotation_rad == pytest.approx(0.02)
    expected = np.sqrt(np.mean((se3.log(SHIFT) / (np.sqrt(2) * SIGMAS)) ** 2))
    assert change.sigmas == pytest.approx(expected)


def test_when_the_root_moved_the_others_did_not() -> None:
    after = {name: se3.inverse(SHIFT) @ T for name, T in POSES.items()}
    comparison = rigcal.compare(_calibration(POSES), _calibration(after))
    assert comparison.reference in POSES
    assert comparison.moved == ("lidar",)
    np.testing.assert_allclose(comparison.sensors["lidar"].T_before_after, SHIFT, atol=1e-12)


def test_trees_of_different_shape_are_compared_by_what_they_say() -> None:
    before = _calibration(POSES)
    T_cam0_cam1 = se3.inverse(POSES["cam0"]) @ POSES["cam1"]
    cam1 = SensorResult("cam0", T_cam0_cam1, np.diag(SIGMAS**2))
    after = replace(before, sensors={**before.sensors, "cam1": cam1})
    comparison = rigcal.compare(before, after)
    assert comparison.moved == ()
    for change in comparison.sensors.values():
        np.testing.assert_allclose(change.T_before_after, np.eye(4), atol=1e-12)


def test_covariance_of_a_chain_is_that_of_scattered_chains() -> None:
    from rigcal.comparison import _in_root

    rng = np.random.default_rng(5)
    T_a_b, covariance = POSES["cam1"], np.diag(SIGMAS**2)
    sensors = {
        "lidar": SensorResult("lidar", np.eye(4)),
        "a": SensorResult("lidar", POSES["cam0"], covariance),
        "b": SensorResult("a", T_a_b, covariance),
    }
    draws = rng.normal(size=(2, 20000, 6)) * SIGMAS
    T = POSES["cam0"] @ se3.exp(draws[0]) @ T_a_b @ se3.exp(draws[1])
    scatter = np.cov(se3.log(se3.inverse(POSES["cam0"] @ T_a_b) @ T).T)
    scale = np.sqrt(np.outer(np.diag(scatter), np.diag(scatter)))
    stated = _in_root(Calibration("lidar", sensors), "b")
    assert np.abs((stated - scatter) / scale).max() < 0.04


def test_what_two_sensors_err_together_does_not_hide_a_motion_between_them() -> None:
    T, names = np.eye(4), ("a", "b", "c")
    common, own = 1e-2 * np.eye(6), 1e-8 * np.eye(18)
    joint = JointCovariance(names, np.kron(np.ones((3, 3)), common) + own)
    sensors = {n: SensorResult("lidar", T, common) for n in names}
    sensors["lidar"] = SensorResult("lidar", T)
    before = Calibration("lidar", sensors, joint_covariance=joint)
    shifted = replace(sensors["b"], T_parent_sensor=SHIFT)
    after = replace(before, sensors={**sensors, "b": shifted})
    assert rigcal.compare(before, after).moved == ()
    assert _changes(before, after, "a", ["a", "b"])["b"].moved


def test_nothing_moved_where_nothing_is_uncertain() -> None:
    bare = {n: SensorResult("lidar", T) for n, T in POSES.items()}
    comparison = rigcal.compare(Calibration("lidar", bare), Calibration("lidar", bare))
    assert [c.sigmas for c in comparison.sensors.values()] == [None] * 2
    assert comparison.moved == ()


def test_covariance_that_is_none_is_refused() -> None:
    wrong = SensorResult("lidar", POSES["cam0"], np.diag([-1e-6, 1, 1, 1, 1, 1]))
    sensors = {"lidar": SensorResult("lidar", np.eye(4)), "cam0": wrong}
    calibration = Calibration("lidar", sensors)
    with pytest.raises(ConfigError, match="covariance of sensor 'cam0' is not positive definite"):
        rigcal.compare(calibration, calibration)


def test_too_little_in_common_is_refused() -> None:
    other = _calibration({"rear": np.eye(4)})
    with pytest.raises(ConfigError, match="they share lidar"):
        rigcal.compare(_calibration(POSES), other)


def test_limit_is_the_point_that_one_in_a_thousand_exceeds() -> None:
    from scipy.stats import chi2

    assert chi2.sf(6 * LIMIT_SIGMAS**2, 6) == pytest.approx(1e-3, rel=1e-4)


def test_command_tells_people_and_scripts(tmp_path: Path, command: Any) -> None:
    a, b = tmp_path / "a.yaml", tmp_path / "b.yaml"
    rigcal.save_calibration(a, _calibration(POSES))
    rigcal.save_calibration(b, _calibration({**POSES, "front": POSES["front"] @ SHIFT}))
    code, text, _ = command("compare", a, b)
    assert code == 1
    assert "Moved: front" in text
    code, text, _ = command("compare", a, b, "--json")
    answer = json.loads(text)
    assert (code, answer["moved"], answer["reference"]) == (1, ["front"], "lidar")
    assert answer["sensors"]["front"]["translation_mm"] == pytest.approx(50, abs=0.1)
    assert answer["sensors"]["cam0"]["moved"] is False
    assert command("compare", a, b, "--quiet") == (1, "", "")
    code, text, _ = command("compare", a, a)
    assert code == 0
    assert "Moved: none" in text


def test_command_does_not_take_a_missing_sensor_for_one_that_stood_still(
    tmp_path: Path, command: Any
) -> None:
    a, b = tmp_path / "a.yaml", tmp_path / "b.yaml"
    rigcal.save_calibration(a, _calibration(POSES))
    rigcal.save_calibration(b, _calibration({n: T for n, T in POSES.items() if n != "front"}))
    code, text, _ = command("compare", a, b)
    assert code == 1
    assert "not in B: front\nMoved: none" in text
    code, text, _ = command("compare", b, a)  # one that was added is no alarm
    assert code == 0
    assert "not in A: front\nMoved: none" in text


def test_command_names_a_file_of_another_kind(tmp_path: Path, command: Any) -> None:
    a, verdict = tmp_path / "a.yaml", tmp_path / "verdict.yaml"
    rigcal.save_calibration(a, _calibration(POSES))
    save_verdict(verdict, {"result": "given"})
    code, text, error = command("compare", a, verdict)
    assert (code, text) == (2, "")
    assert error == (
        f"rigcal: {verdict}:1: format: found 'rigcal-verdict', expected 'rigcal-calibration', "
        "which is the calibration.yaml that `rigcal calibrate` writes, or a rig file with poses\n"
    )
    verdict.write_text("format: {kind: verdict}\n")
    assert "found a mapping, expected 'rigcal-calibration'" in command("compare", a, verdict).err
