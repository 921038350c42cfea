"""Covariances: the Schur complement against GTSAM's own marginals."""

import gtsam
import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal.graph.edge import SensorTargetEdge
from rigcal.graph.information import Ends, eliminate, information
from rigcal.graph.joint import solve
from rigcal.graph.numbers import NO_NUMBERS
from rigcal.residual import PoseResidual, whitener

COV = np.diag([1e-6, 2e-6, 3e-6, 1e-5, 2e-5, 4e-5])


def problem(rng, sensors=3, boards=8):
    T_root = {f"s{i}": se3.exp(rng.normal(0, 0.3, 6)) if i else np.eye(4) for i in range(sensors)}
    T_board = {str(k): se3.exp(rng.normal(0, 0.5, 6)) for k in range(boards)}
    noise = np.linalg.cholesky(COV)
    edges = [
        SensorTargetEdge(
            s,
            k,
            PoseResidual(
                se3.inverse(T_root[s]) @ T_board[k] @ se3.exp(noise @ rng.normal(size=6)),
                whitener(COV),
            ),
        )
        for s in T_root
        for k in T_board
    ]
    return edges, T_root, T_board


def test_marginal_covariance_is_that_of_gtsam():
    edges, T_root, T_board = problem(np.random.default_rng(0))
    fixed = frozenset({"s0"})
    sensors, boards, _ = solve(edges, T_root, T_board, fixed)
    info = information(edges, sensors, boards, fixed)

    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    keys = {n: i for i, n in enumerate([*sensors, *boards])}
    for name, T in (sensors | boards).items():
        values.insert(keys[name], gtsam.Pose3(T))
    graph.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(), gtsam.noiseModel.Isotropic.Sigma(6, 1e-9)))
    noise = gtsam.noiseModel.Gaussian.Covariance(COV)
    for e in edges:
        measured = gtsam.Pose3(e.residual.T_s_t)
        graph.add(gtsam.BetweenFactorPose3(keys[e.sensor], keys[e.exposure], measured, noise))
    marginals = gtsam.Marginals(graph, values)
    for s in ("s1", "s2"):
        expected = marginals.marginalCovariance(keys[s])
        np.testing.assert_allclose(info.covariance_of(s), expected, rtol=2e-2, atol=1e-9)


def test_leverage_sums_to_the_number_of_unknowns():
    edges, T_root, T_board = problem(np.random.default_rng(1))
    info = information(edges, T_root, T_board, frozenset({"s0"}))
    assert sum(f.leverage for f in info.fits) == pytest.approx(6 * (2 + len(T_board)), rel=1e-4)
    # A residual of six rows on a pose is all disagreement: it has no scatter of its own.
    assert all(f.misfit == pytest.approx(f.chi2) for f in info.fits)


def test_a_direction_without_data_has_no_small_covariance():
    info = information([], {"a": np.eye(4), "b": np.eye(4)}, {}, frozenset({"a"}))
    assert np.diagonal(info.covariance).min() > 1e6


def test_a_target_that_is_open_to_rounding_is_no_singular_matrix():
    """Six rows that are all the same, with enormous weight: adding 1e-6 to the diagonal is lost."""
    H = 1e12 * np.ones((1, 6, 6))
    ends = Ends(np.array([-1]), np.array([0]), np.eye(6)[None])
    _, _, covariances = eliminate(H, ends, 0, 1, NO_NUMBERS)
    assert np.isfinite(covariances).all()
    along = np.ones(6) / np.sqrt(6)
    assert np.isclose(along @ covariances[0] @ along, 1 / 6e12, rtol=1e-2)
