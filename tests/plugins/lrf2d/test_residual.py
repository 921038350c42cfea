from __future__ import annotations

import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal.geometry.shapes import plane_of_target
from rigcal.observation import Candidate
from rigcal.scene import Scene
from rigcal_lrf2d import LRF2D
from rigcal_lrf2d.simulator import observe, simulate


def candidates(world, config, count: int) -> list[tuple[np.ndarray, Candidate]]:
    """Poses and what the sensor makes of the board there, alone in an empty room."""
    found = []
    for seed in range(count):
        rng = np.random.default_rng(seed)
        T_s_t = world.pose(rng)
        candidate = observe(T_s_t, config, world.target, rng)
        if candidate is not None:
            found.append((T_s_t, candidate))
    return found


@pytest.mark.parametrize("angle", [0.0, 0.15])
def test_at_the_truth_the_residual_is_chi_square_distributed(world, angle: float) -> None:
    config = world.config.model_copy(update={"sigma_angle_deg": angle})
    chi2, dof = 0.0, 0
    for T_s_t, candidate in candidates(world, config, 120):
        residual = LRF2D.residual(candidate, config, world.target)
        r, _ = residual(T_s_t)
        assert r.shape == (2,)
        chi2, dof = chi2 + float(r @ r), dof + residual.dof
    # Standard error of chi2 / dof is sqrt(2 / 240) = 0.09.
    assert dof > 220
    assert chi2 / dof == pytest.approx(1, abs=0.27)


@pytest.mark.parametrize("angle", [0.0, 0.4])
def test_the_errors_have_the_configured_noise(world, angle: float) -> None:
    config = world.config.model_copy(update={"sigma_angle_deg": angle})
    errors, whitened = [], []
    for T_s_t, candidate in candidates(world, config, 60):
        n, d = plane_of_target(T_s_t)
        angles = np.asarray(candidate.measurement["angles"], np.float64)
        along, across = np.cos(angles), np.sin(angles)
        # dr/da of r = -d / (n . u)
        slope = d * (n[1] * along - n[0] * across) / (n[0] * along + n[1] * across) ** 2
        errors.append(LRF2D.errors(candidate, config, world.target, T_s_t))
        whitened.append(errors[-1] / np.hypot(0.01, slope * np.radians(angle)))
    assert np.mean(np.concatenate(errors)) == pytest.approx(0, abs=0.0005)
    assert np.std(np.concatenate(whitened)) == pytest.approx(1, rel=0.03)


def test_the_errors_are_in_metres_and_positive_beyond_the_board(world) -> None:
    facing = se3.transform(np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]]), np.array([2.0, 0, 0]))
    candidate = observe(facing, world.config, world.target, np.random.default_rng(0))
    assert candidate is not None
    nearer = facing.copy()
    nearer[0, 3] -= 0.1
    errors = LRF2D.errors(candidate, world.config, world.target, nearer)
    assert errors.shape == candidate.measurement["ranges"].shape
    assert np.mean(errors) == pytest.approx(0.1, abs=0.005)


def test_the_jacobian_agrees_with_central_differences(world) -> None:
    for T_s_t, candidate in candidates(world, world.config, 20):
        residual = LRF2D.residual(candidate, world.config, world.target)
        at = T_s_t @ se3.exp(np.array([0.02, -0.03, 0.01, 0.01, 0.02, -0.03]))
        _, J = residual(at)
        steps = 1e-6 * np.eye(6)
        numeric = np.column_stack(
            [(residual(at @ se3.exp(h))[0] - residual(at @ se3.exp(-h))[0]) / 2e-6 for h in steps]
        )
        np.testing.assert_allclose(J, numeric, atol=1e-5 * np.abs(J).max())


def test_the_compressed_residual_costs_what_all_beams_cost(world) -> None:
    for T_s_t, candidate in candidates(world, world.config, 20):
        residual = LRF2D.residual(candidate, world.config, world.target)
        costs = []
        for h in ([0.0] * 6, [0.003, 0.002, -0.004, 0.003, -0.002, 0.004]):
            at = T_s_t @ se3.exp(np.array(h))
            full = LRF2D.errors(candidate, world.config, world.target, at) / world.config.sigma_m
            costs.append(float(full @ full) - float(np.sum(residual(at)[0] ** 2)))
        assert costs[0] == pytest.approx(costs[1], rel=0.02)


def test_a_target_out_of_sight_is_not_observed(world) -> None:
    above = se3.transform(np.eye(3), np.array([2.0, 0, 1.5]))
    assert observe(above, world.config, world.target, np.random.default_rng(0)) is None


def test_observing_equals_detecting_the_target_alone(world) -> None:
    T_s_t = world.pose(np.random.default_rng(5))
    scan = simulate(np.eye(4), Scene(world.target, T_s_t), world.config, np.random.default_rng(6))
    best = LRF2D.detect(scan, world.config, world.target).candidates[0]
    observed = observe(T_s_t, world.config, world.target, np.random.default_rng(6))
    assert observed is not None
    np.testing.assert_array_equal(best.measurement["ranges"], observed.measurement["ranges"])


def test_noise_that_grows_with_the_range_is_whitened(world) -> None:
    """Boards from 1 to 10 m away; their residuals at the truth are chi-square distributed."""
    config = world.config.model_copy(update={"sigma_m": 0.003, "sigma_per_m": 0.006})
    chi2, dof, errors = 0.0, 0, []
    for seed in range(150):
        rng = np.random.default_rng(seed)
        T_s_t = world.pose(rng)
        T_s_t[:3, 3] *= 1 + seed % 3
        candidate = observe(T_s_t, config, world.target, rng)
        if candidate is None:
            continue
        residual = LRF2D.residual(candidate, config, world.target)
        r, _ = residual(T_s_t)
        chi2, dof = chi2 + float(r @ r), dof + residual.dof
        e = LRF2D.errors(candidate, config, world.target, T_s_t)
        errors.append(e / config.noise.of(candidate.measurement["ranges"] - e))
    assert dof > 200
    assert chi2 / dof == pytest.approx(1, abs=4 * np.sqrt(2 / dof))
    assert np.std(np.concatenate(errors)) == pytest.approx(1, abs=0.03)
