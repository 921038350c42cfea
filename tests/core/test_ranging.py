from __future__ import annotations

from typing import Any, Literal

import numpy as np
import pytest
from pydantic import ValidationError
from scipy import stats

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.ranging import RangeConfig, RangeEffects, RangeNoise, measure, turned
from rigcal.scene import Scene, Surface
from rigcal.targets.target import Target, TargetConfig

SQUARE = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
BOARD = Target("board", TargetConfig(type="plain"), 0.5 * SQUARE, np.zeros((0, 3)))
FACING = np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]])
AHEAD = np.array([[1.0, 0.0, 0.0]])


class BeamConfig(RangeConfig, frozen=True):
    type: Literal["beam"] = "beam"


def at(x: float, y: float = 0.0) -> Array:
    return se3.transform(FACING, np.array([x, y, 0.0]))


BOARD_AT_2_M = Scene(BOARD, at(2.0), (Surface(at(5.0), 4 * SQUARE),))


def ranges(
    count: int = 1, scene: Scene = BOARD_AT_2_M, seed: int = 0, d: Array = AHEAD,
    config: dict[str, Any] | None = None, **effects: Any,
) -> Array:  # fmt: skip
    """What beams straight ahead report."""
    made = BeamConfig.model_validate(config or {})
    rng = np.random.default_rng(seed)
    d_w = np.repeat(d, count, axis=0)
    return measure(scene, np.zeros(3), d_w, made, RangeEffects(**effects), rng)


def test_the_noise_has_constant_proportional_and_quadratic_parts() -> None:
    noise = RangeNoise(0.01, 0.002, 0.001)
    assert noise.of(np.array([0.0, 1.0, 10.0])) == pytest.approx([0.01, 0.013, 0.13])


def test_on_a_slanted_plane_the_angle_noise_adds_to_it() -> None:
    noise = RangeNoise(0.01, angle_rad=0.002)
    slant = np.radians(60.0)
    sigma = noise.on_plane(np.array([3.0, 3.0]), -np.cos([0.0, slant]))
    assert sigma == pytest.approx([0.01, np.hypot(0.01, 3 * np.sqrt(3) * 0.002)])


@pytest.mark.parametrize("distance", [1.0, 4.0])
def test_simulated_ranges_have_the_configured_sigma(distance: float) -> None:
    config = {"sigma_m": 0.004, "sigma_per_m": 0.002, "sigma_per_m2": 0.001}
    sigma = 0.004 + 0.002 * distance + 0.001 * distance**2
    scene, count = Scene(BOARD, at(distance)), 20_000
    errors = ranges(count, scene, config=config) - distance
    low, high = stats.chi2(count).ppf([0.001, 0.999])
    assert low < np.sum((errors / sigma) ** 2) < high
    assert abs(np.mean(errors)) < 4 * sigma / np.sqrt(count)


def test_noise_can_be_turned_off_and_up() -> None:
    assert ranges(5, noise=0.0).tolist() == [2.0] * 5
    assert np.std(ranges(2000, noise=3.0)) == pytest.approx(0.03, rel=0.1)


def test_bias_shifts_and_quantisation_rounds_the_range() -> None:
    assert ranges(noise=0.0, bias_m=0.013)[0] == pytest.approx(2.013)
    rounded = ranges(500, quantisation_m=0.025)
    np.testing.assert_allclose(rounded / 0.025, np.round(rounded / 0.025), atol=1e-9)
    assert len(np.unique(rounded)) > 1


def test_beyond_the_limits_and_behind_the_sensor_is_no_return() -> None:
    assert ranges(noise=0.0, config={"range_max_m": 1.9})[0] == np.inf
    assert ranges(noise=0.0, config={"range_min_m": 2.1})[0] == np.inf
    assert ranges(noise=0.0, d=-AHEAD)[0] == np.inf
    assert ranges(noise=0.0, bias_m=-2.5)[0] == np.inf


def test_a_share_of_returns_is_lost() -> None:
    found = ranges(20_000, dropout=0.3)
    assert np.mean(np.isinf(found)) == pytest.approx(0.3, abs=0.015)
    assert np.isinf(ranges(10, dropout=1.0)).all()


def test_a_share_of_returns_is_anywhere_within_the_limits() -> None:
    config = {"range_min_m": 1.0, "range_max_m": 9.0}
    found = ranges(20_000, config=config, outliers=0.2)
    off = found[np.abs(found - 2.0) > 0.06]
    # Outliers within 6 sigma of the truth do not count here.
    assert len(off) / 20_000 == pytest.approx(0.2 * (1 - 0.12 / 8), abs=0.012)
    assert stats.kstest((off - 1.0) / 8.0, "uniform").statistic < 0.05
    empty = Scene(BOARD, None)
    assert np.isinf(ranges(50, empty, outliers=1.0)).all()


def test_effects_leave_the_noise_of_the_others_alone() -> None:
    plain, some = ranges(1000), ranges(1000, dropout=0.4)
    kept = np.isfinite(some)
    np.testing.assert_array_equal(some[kept], plain[kept])


def toward(y: float) -> Array:
    d = np.array([[2.0, y, 0.0]])
    return d / np.linalg.norm(d)


def test_a_wide_beam_reports_a_range_between_at_an_edge_only() -> None:
    """The board's edge is at y = 0.5; the footprint there is 2 m x 1 deg, 35 mm, wide."""
    options: dict[str, Any] = {"noise": 0.0, "divergence_deg": 1.0}
    for y in (0.0, 0.3, 0.45):
        assert ranges(d=toward(y), **options)[0] == pytest.approx(np.hypot(2, y), abs=1e-12)
    assert 2.5 < ranges(d=toward(0.5), **options)[0] < 4.5
    assert ranges(d=toward(0.55), **options)[0] == pytest.approx(5 / 2 * np.hypot(2, 0.55))
    mixed = [ranges(d=toward(y), **options)[0] for y in np.linspace(0.48, 0.52, 9)]
    assert mixed == sorted(mixed)


def test_a_wide_beam_that_mostly_misses_does_not_return() -> None:
    alone = Scene(BOARD, at(2.0))
    options: dict[str, Any] = {"scene": alone, "noise": 0.0, "divergence_deg": 1.0}
    assert ranges(d=toward(0.49), **options)[0] == pytest.approx(np.hypot(2, 0.49), abs=0.02)
    assert ranges(d=toward(0.512), **options)[0] == np.inf


def test_directions_are_turned_by_the_given_sigma() -> None:
    d = np.repeat(toward(1.0), 20_000, axis=0)
    aimed = turned(d, 0.01, np.random.default_rng(0))
    np.testing.assert_allclose(np.linalg.norm(aimed, axis=1), 1.0)
    angles = np.arccos(np.clip(np.sum(aimed * d, axis=1), -1, 1))
    assert np.mean(angles**2) == pytest.approx(2 * 0.01**2, rel=0.04)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"sigma_m": -0.01}, "sigma_m"),
        ({"sigma_per_m": -0.1}, "sigma_per_m"),
        ({"range_min_m": 5, "range_max_m": 4}, "range_min_m 5 is not below range_max_m 4"),
        ({"filter": {"ring": [9, 8]}}, r"ring goes from 9 to 8; write \[low, high\]"),
    ],
)
def test_a_noise_that_cannot_be_is_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        BeamConfig.model_validate(wrong)
