"""Errors against the truth."""

from __future__ import annotations

import numpy as np
import pytest

from rigcal.calibration import Calibration, SensorResult
from rigcal.errors import ConfigError
from rigcal.evaluation import evaluate
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array

RNG = np.random.default_rng(1)
T_A_B, T_A_C = se3.exp(RNG.normal(size=6)), se3.exp(RNG.normal(size=6))
TRUTH = Calibration("a", {"a": SensorResult("a", np.eye(4)), "b": SensorResult("a", T_A_B),
                          "c": SensorResult("a", T_A_C)})  # fmt: skip


def _moved(xi: list[float], covariance: Array | None = None) -> Calibration:
    moved = SensorResult("a", T_A_B @ se3.exp(np.array(xi)), covariance)
    return Calibration("a", {**TRUTH.sensors, "b": moved})


def test_truth_against_itself_is_zero() -> None:
    evaluation = evaluate(TRUTH, TRUTH)
    assert list(evaluation.sensors) == ["b", "c"]
    assert evaluation.rms_translation_m == pytest.approx(0, abs=1e-12)
    assert evaluation.rms_rotation_rad == pytest.approx(0, abs=1e-7)


def test_translation_and_rotation_errors_and_their_means() -> None:
    evaluation = evaluate(_moved([0.0, 0.03, 0.0, 0.0, 0.0, 0.0]), TRUTH)
    assert evaluation.sensors["b"].rotation_rad == pytest.approx(0.03)
    assert evaluation.sensors["b"].translation_m == pytest.approx(0, abs=1e-12)
    assert evaluation.mean_rotation_rad == pytest.approx(0.015)
    assert evaluation.rms_rotation_rad == pytest.approx(0.03 / np.sqrt(2))
    evaluation = evaluate(_moved([0.0, 0.0, 0.0, 0.003, 0.0, 0.004]), TRUTH)
    assert evaluation.mean_translation_m == pytest.approx(0.0025)


def test_angle_of_the_principal_axis_sees_tilt_and_no_turn_about_it() -> None:
    tilted = evaluate(_moved([0.03, 0.04, 0.0, 0.0, 0.0, 0.0]), TRUTH)
    assert tilted.sensors["b"].axis_rad == pytest.approx(0.05)
    assert tilted.mean_axis_rad == pytest.approx(0.025)
    assert tilted.rms_axis_rad == pytest.approx(0.05 / np.sqrt(2))
    turned = evaluate(_moved([0.0, 0.0, 0.4, 0.0, 0.0, 0.0]), TRUTH).sensors["b"]
    assert turned.axis_rad == pytest.approx(0.0, abs=1e-12)
    assert turned.rotation_rad == pytest.approx(0.4)


def test_error_in_sigmas() -> None:
    covariance = np.diag([0.01, 0.01, 0.01, 0.1, 0.1, 0.1]) ** 2
    error = evaluate(_moved([0.02, 0.0, 0.0, 0.0, 0.0, 0.0], covariance), TRUTH).sensors["b"]
    assert error.nees == pytest.approx(4.0)
    assert error.sigmas == pytest.approx(np.sqrt(4 / 6))
    assert evaluate(TRUTH, TRUTH).sensors["b"].nees is None


def test_covariance_that_gives_no_standard_deviations_is_an_error() -> None:
    singular = _moved([0.02, 0.0, 0.0, 0.0, 0.0, 0.0], np.diag([1e-4] * 5 + [0.0]))
    with pytest.raises(ConfigError, match=r"sensor 'b' is not positive definite.*leave it out"):
        evaluate(singular, TRUTH)


def test_covariance_counts_in_the_parent_where_it_is_stated() -> None:
    # b is off by 2 sigmas in a, c by 1 sigma in b, whatever c is in the root.
    sigma = np.diag([0.01] * 6) ** 2
    T_b_c = se3.inverse(T_A_B) @ T_A_C @ se3.exp(np.array([0.0, 0.01, 0.0, 0.0, 0.0, 0.0]))
    moved = _moved([0.0, 0.0, 0.0, 0.02, 0.0, 0.0], sigma)
    chained = {**moved.sensors, "c": SensorResult("b", T_b_c, sigma)}
    errors = evaluate(Calibration("a", chained), TRUTH).sensors
    assert errors["b"].nees == pytest.approx(4.0)
    assert errors["c"].nees == pytest.approx(1.0)


def test_truth_may_hang_from_another_sensor() -> None:
    other = Calibration("c", {
        "c": SensorResult("c", np.eye(4)),
        "a": SensorResult("c", se3.inverse(T_A_C)),
        "b": SensorResult("a", T_A_B),
    })  # fmt: skip
    evaluation = evaluate(TRUTH, other)
    assert evaluation.rms_translation_m == pytest.approx(0, abs=1e-12)


def test_sensors_in_one_of_them_are_named() -> None:
    fewer = Calibration("a", {n: r for n, r in TRUTH.sensors.items() if n != "c"})
    assert evaluate(TRUTH, fewer).only_in_calibration == ("c",)
    assert evaluate(fewer, TRUTH).only_in_truth == ("c",)


def test_nothing_to_compare_is_an_error() -> None:
    alone = Calibration("a", {"a": SensorResult("a", np.eye(4))})
    with pytest.raises(ConfigError, match="they share only the root"):
        evaluate(TRUTH, alone)
    with pytest.raises(ConfigError, match="root 'a' is not in the truth"):
        evaluate(TRUTH, Calibration("x", {"x": SensorResult("x", np.eye(4))}))
