"""Residuals: Jacobians, whitening, and that the compressed beams lose nothing."""

import numpy as np
import pytest

from rigcal.errors import ObservationError
from rigcal.geometry import se3
from rigcal.geometry.shapes import plane_of_target
from rigcal.observation import (
    Candidate,
    LineGeometry,
    PlaneGeometry,
    PointGeometry,
    PoseGeometry,
)
from rigcal.residual import beam_residual, residual_of_geometry

T_S_T = se3.transform(se3.rotation_from_rpy(np.array([0.3, -1.3, 0.4])), np.array([2.0, 0.2, 0.1]))


def numeric_jacobian(residual, T, step=1e-6):
    columns = []
    for i in range(6):
        xi = np.zeros(6)
        xi[i] = step
        columns.append((residual(T @ se3.exp(xi))[0] - residual(T @ se3.exp(-xi))[0]) / (2 * step))
    return np.stack(columns, axis=1)


def beams(rng, planar, count=400, sigma=0.01):
    """Beams that hit the infinite plane of the target, with noise."""
    n, d = plane_of_target(T_S_T)
    azimuth = rng.uniform(-0.2, 0.3, count)
    elevation = np.zeros(count) if planar else rng.uniform(-0.15, 0.2, count)
    rho = np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ],
        axis=1,
    )
    return rho, -d / (rho @ n) + rng.normal(0, sigma, count), np.full(count, sigma), n, d


def make(kind, rng):
    if kind == "beams":
        return beam_residual(*beams(rng, False))
    if kind == "scan":
        rho, ranges, sigma, n, d = beams(rng, True)
        s = np.hypot(n[0], n[1])
        return beam_residual(rho, ranges, sigma, np.array([*n[:2], 0]) / s, d / s, planar=True)
    B = rng.normal(size=(6, 6)) * 0.01
    cov = B @ B.T + 1e-6 * np.eye(6)
    n, d = plane_of_target(T_S_T)
    geometry = {
        "pose": PoseGeometry(T_S_T @ se3.exp(rng.normal(size=6) * 0.1), cov),
        "plane": PlaneGeometry(n, float(d), -n * d, cov[:3, :3]),
        "line": LineGeometry(np.array([2.0, -0.3, 0]), np.array([2.1, 0.4, 0]), cov),
        "point": PointGeometry(np.array([2.0, 0.1, 0.3]), cov[:3, :3], np.array([0.2, -0.1, 0.0])),
    }[kind]
    return residual_of_geometry(Candidate(geometry, {}))


@pytest.mark.parametrize("kind", ["pose", "plane", "line", "point", "beams", "scan"])
def test_jacobian_is_the_derivative(kind):
    rng = np.random.default_rng(1)
    for _ in range(20):
        residual = make(kind, rng)
        T = T_S_T @ se3.exp(rng.normal(size=6) * 0.3)
        r, J = residual(T)
        assert r.shape == (residual.dof,)
        np.testing.assert_allclose(J, numeric_jacobian(residual, T), rtol=2e-5, atol=2e-4)


@pytest.mark.parametrize("planar", [False, True])
def test_compressed_beams_have_the_cost_and_gradient_of_all_beams(planar):
    rng = np.random.default_rng(2)
    rho, ranges, sigma, n, d = beams(rng, planar)
    s = np.hypot(n[0], n[1]) if planar else 1.0
    normal = np.array([n[0] / s, n[1] / s, 0.0 if planar else n[2]])
    compressed = beam_residual(rho, ranges, sigma, normal, d / s, planar=planar)

    def cost(T):
        m, e = plane_of_target(T)
        return np.sum(((ranges + e / (rho @ m)) / sigma) ** 2)

    differences = []
    for _ in range(30):
        T = T_S_T @ se3.exp(rng.normal(size=6) * 2e-3)
        differences.append(cost(T) - np.sum(compressed(T)[0] ** 2))
    # Equal up to a constant: the misfit of the best plane.
    assert np.ptp(differences) < 0.02 * np.mean([cost(T_S_T)])
    assert np.mean(differences) == pytest.approx(len(ranges) - compressed.dof, rel=0.3)


@pytest.mark.parametrize("planar", [False, True])
def test_residual_at_the_truth_is_chi_square(planar):
    rng = np.random.default_rng(3)
    values = []
    for _ in range(400):
        rho, ranges, sigma, n, d = beams(rng, planar, count=60)
        s = np.hypot(n[0], n[1]) if planar else 1.0
        normal = np.array([n[0] / s, n[1] / s, 0.0 if planar else n[2]])
        residual = beam_residual(rho, ranges, sigma, normal, d / s, planar=planar)
        values.append(np.sum(residual(T_S_T)[0] ** 2))
    dof = residual.dof
    assert np.mean(values) == pytest.approx(dof, abs=4 * np.sqrt(2 * dof / 400))


def test_too_few_beams_are_refused():
    rho, ranges, sigma, n, d = beams(np.random.default_rng(0), False, count=2)
    with pytest.raises(ObservationError, match="2 beams do not determine a plane"):
        beam_residual(rho, ranges, sigma, n, d)


def test_covariance_that_is_not_positive_definite_is_refused():
    with pytest.raises(ObservationError, match="positive definite"):
        residual_of_geometry(Candidate(PoseGeometry(T_S_T, np.zeros((6, 6))), {}))
