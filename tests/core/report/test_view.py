"""The rims of fields of view, as they are drawn."""

from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest

from rigcal.geometry.se3 import Array
from rigcal.plugin import Detection, SensorConfig, SensorType
from rigcal.report.view import rims


class EyeConfig(SensorConfig, frozen=True):
    type: Literal["eye"] = "eye"
    most_deg: float = 30.0
    backward: bool = False


def _sees(p_s: Array, config: Any) -> Any:
    x = -p_s[:, 0] if config.backward else p_s[:, 0]
    return x >= np.cos(np.radians(config.most_deg)) * np.linalg.norm(p_s, axis=1) - 1e-9


EYE = SensorType("eye", EyeConfig, (), lambda *_: None, lambda *_: Detection(()), sees=_sees)
FLAT = replace(EYE, flat=True)


@pytest.mark.parametrize("backward", [False, True])
def test_a_cone_has_a_circle_around_it(backward):
    rim = np.vstack(rims(EYE, EyeConfig(backward=backward), 2.0))
    assert np.all(np.ptp(rim, axis=0)[1:] > 1.95)
    np.testing.assert_allclose(np.linalg.norm(rim, axis=1), 2.0)
    off = np.degrees(np.arccos(np.abs(rim[:, 0]) / 2))
    np.testing.assert_allclose(off, 30.0, atol=1.0)
    assert np.all((rim[:, 0] < 0) == backward)


@pytest.mark.parametrize("backward", [False, True])
def test_a_flat_sensor_has_a_fan_from_its_origin(backward):
    (fan,) = rims(FLAT, EyeConfig(backward=backward), 2.0)
    np.testing.assert_array_equal(fan[[0, -1]], 0.0)
    bearing = np.degrees(np.arctan2(fan[1:-1, 1], fan[1:-1, 0] * (-1 if backward else 1)))
    assert np.ptp(bearing) == pytest.approx(60.0, abs=1.5)
    assert not fan[:, 2].any()


def test_a_flat_sensor_that_sees_all_around_has_a_closed_circle():
    (ring,) = rims(FLAT, EyeConfig(most_deg=180.0), 2.0)
    np.testing.assert_allclose(np.linalg.norm(ring, axis=1), 2.0)
    np.testing.assert_array_equal(ring[0], ring[-1])


def test_what_sees_all_nothing_or_does_not_tell_has_no_rim():
    assert rims(EYE, EyeConfig(most_deg=180.0), 2.0) == []
    blind = replace(FLAT, sees=lambda p_s, _: np.zeros(len(p_s), bool))
    assert rims(blind, EyeConfig(), 2.0) == []
    assert rims(replace(EYE, sees=None), EyeConfig(), 2.0) == []
