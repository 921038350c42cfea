import numpy as np
import pytest

from rigcal.errors import ObservationError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import fit_plane, plane_of_target, tangent_basis
from rigcal.observation import Candidate, PlaneGeometry, PointGeometry
from rigcal.targets.target import Target
from rigcal_lrf3d import LRF3D, Lrf3dConfig
from rigcal_lrf3d.plane import fit
from rigcal_lrf3d.residual import errors, residual

BEAMS = [
    Lrf3dConfig(beam_origin="sensor", sigma_m=0.01),
    Lrf3dConfig(beam_origin="unknown", sigma_m=0.01),
    Lrf3dConfig(beam_origin="sensor", sigma_m=0.01, sigma_angle_deg=0.2),
]
T_S_T = se3.transform(se3.rotation_from_rpy(np.array([0.2, -1.0, 0.3])), np.array([2.4, 0.3, -0.2]))
"""A board seen at about 35 degrees of incidence."""


def returns(config: Lrf3dConfig, seed: int, count: int = 200) -> Array:
    """(count, 3) noisy returns from a board at T_S_T, errors along the beams and across them."""
    rng = np.random.default_rng(seed)
    p_t = np.column_stack([rng.uniform(-0.5, 0.5, (count, 2)), np.zeros(count)])
    p_s = se3.apply(T_S_T, p_t)
    d = p_s / np.linalg.norm(p_s, axis=1, keepdims=True)
    aimed = d + rng.normal(0, np.radians(config.sigma_angle_deg), d.shape)
    aimed /= np.linalg.norm(aimed, axis=1, keepdims=True)
    n, distance = plane_of_target(T_S_T)
    ranges = -distance / (aimed @ n) + rng.normal(0, config.sigma_m, count)
    points: Array = ranges[:, None] * d
    return points


def candidate(points: Array) -> Candidate:
    n, d = fit_plane(points)
    geometry = PlaneGeometry(n, d, points.mean(axis=0), np.eye(3))
    return Candidate(geometry, {"points": points.astype(np.float32)})


@pytest.mark.parametrize("config", BEAMS)
def test_the_residual_at_the_truth_is_white(config: Lrf3dConfig, board: Target) -> None:
    r = np.array(
        [residual(candidate(returns(config, k)), config, board)(T_S_T)[0] for k in range(300)]
    )
    assert r.shape[1] == 3
    chi2 = np.sum(r**2, axis=1)
    assert np.mean(chi2) == pytest.approx(3.0, abs=5 * np.sqrt(6 / 300))


@pytest.mark.parametrize("config", BEAMS)
def test_the_jacobian_is_the_derivative(config: Lrf3dConfig, board: Target) -> None:
    function = residual(candidate(returns(config, 1)), config, board)
    T = T_S_T @ se3.exp(np.array([0.02, -0.01, 0.03, 0.01, 0.02, -0.02]))
    h = 1e-6
    steps = [
        (function(T @ se3.exp(h * e))[0] - function(T @ se3.exp(-h * e))[0]) for e in np.eye(6)
    ]
    expected = np.array(steps).T / (2 * h)
    np.testing.assert_allclose(function(T)[1], expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("config", BEAMS[:2])
def test_three_rows_stand_for_all_returns(config: Lrf3dConfig, board: Target) -> None:
    """The cost grows from pose to pose as the sum of squares of all whitened errors does."""
    points = returns(config, 2)
    function = residual(candidate(points), config, board)
    n, _ = fit_plane(points)
    cosine = (
        1.0 if config.beams_start_at_sensor else np.abs(points @ n) / np.linalg.norm(points, axis=1)
    )
    nearby = T_S_T @ se3.exp(np.array([2e-3, -1e-3, 0, 0, 0, 2e-3]))

    def cost(T: Array) -> float:
        return float(
            np.sum((errors(candidate(points), config, board, T) / config.sigma_m / cosine) ** 2)
        )

    compressed = np.sum(function(nearby)[0] ** 2) - np.sum(function(T_S_T)[0] ** 2)
    assert compressed == pytest.approx(cost(nearby) - cost(T_S_T), rel=0.03)


def test_errors_are_ranges_where_beams_start_at_the_sensor(board: Target) -> None:
    p = np.array([[2.0, 0.0, 0.0], [2.1, 0.7, 0.0]])
    T_s_t = se3.transform(np.array([[0, 0, -1.0], [-1, 0, 0], [0, 1, 0]]), np.array([1.9, 0, 0]))
    c = Candidate(PlaneGeometry(np.array([-1.0, 0, 0]), 1.9, p[0], np.eye(3)), {"points": p})
    along = errors(c, Lrf3dConfig(beam_origin="sensor"), board, T_s_t)
    across = errors(c, Lrf3dConfig(beam_origin="unknown"), board, T_s_t)
    np.testing.assert_allclose(along, [0.1, 0.2 * np.hypot(2.1, 0.7) / 2.1])
    np.testing.assert_allclose(across, [0.1, 0.2])


def test_a_candidate_of_another_geometry_is_refused(board: Target) -> None:
    point = PointGeometry(np.zeros(3), np.eye(3), np.zeros(3))
    wrong = Candidate(point, {"points": returns(BEAMS[0], 1)})
    with pytest.raises(ObservationError, match="PointGeometry, expected PlaneGeometry"):
        residual(wrong, BEAMS[0], board)


@pytest.mark.parametrize("config", [BEAMS[0], BEAMS[2]])
def test_the_fitted_planes_covariance_is_true(config: Lrf3dConfig) -> None:
    """The normalised squared error over 300 noise seeds is chi-square with 3 degrees of freedom."""
    n_true, d_true = plane_of_target(T_S_T)
    n_true, d_true = (n_true, d_true) if d_true > 0 else (-n_true, -d_true)
    nees = []
    for seed in range(300):
        points = returns(config, seed)
        plane = fit(points, *fit_plane(points), config.noise, 0.1)
        assert plane is not None
        w = np.cross(plane.normal, n_true)
        v = np.append(tangent_basis(plane.normal).T @ w, -(n_true @ plane.center + d_true))
        nees.append(v @ np.linalg.solve(plane.covariance, v))
    assert np.mean(nees) == pytest.approx(3.0, abs=5 * np.sqrt(6 / 300))


def test_mixed_pixels_do_not_bend_the_plane() -> None:
    config = BEAMS[0]
    points = returns(config, 4, 400)
    rng = np.random.default_rng(4)
    bad = points.copy()
    bad[:60] *= (1 + rng.uniform(0.03, 0.5, 60))[:, None]
    clean, dirty = (fit(p, *fit_plane(points), config.noise, 0.1) for p in (points[60:], bad))
    assert clean is not None
    assert dirty is not None
    assert dirty.normal @ clean.normal > np.cos(np.radians(0.1))
    assert not dirty.inliers[:60].any()


def test_beams_along_the_plane_neither_count_nor_cost() -> None:
    """Their feet lie at infinity: a floor that runs into a board's plane has such beams."""
    config = Lrf3dConfig(beam_origin="sensor", sigma_m=0.03)
    points = returns(config, 5)
    n, d = fit_plane(points)
    along = np.cross(n, [0.0, 0.0, 1.0]) * np.linspace(50, 5000, 30)[:, None]
    grazing = along - n * (d - 0.02)
    plane = fit(np.concatenate([points, grazing]), n, d, config.noise, 0.06)
    assert plane is not None
    assert not plane.inliers[len(points) :].any()
    assert plane.normal @ n > np.cos(np.radians(0.2))


def test_the_type_offers_them() -> None:
    assert (LRF3D.residual, LRF3D.errors, LRF3D.unit) == (residual, errors, "m")
