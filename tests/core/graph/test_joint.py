"""The joint estimate from poor starts, and with open directions."""

import numpy as np
import pytest

from rigcal.errors import NotConvergedError
from rigcal.geometry import se3
from rigcal.graph.edge import SensorTargetEdge
from rigcal.graph.joint import solve, solve_robust
from rigcal.residual import PlaneResidual, PointResidual, PoseResidual

FIXED = frozenset({"s0"})


def rig_of_points(rng, sigma=1e-3, sensors=3, boards=12):
    """Sensors that measure five points of every board, and the true poses."""
    turn = rng.normal(0, 1.0, (sensors, 6)) * [1, 1, 1, 0.3, 0.3, 0.3]
    T_root = {f"s{i}": se3.exp(turn[i]) if i else np.eye(4) for i in range(sensors)}
    T_board = {str(k): se3.exp(rng.normal(0, 0.5, 6)) for k in range(boards)}
    p_t = np.array([[0, 0, 0], [0.5, 0, 0], [0, 0.5, 0], [-0.5, 0, 0], [0, -0.5, 0.0]])
    edges = []
    for s, T_root_s in T_root.items():
        for k, T_root_t in T_board.items():
            T_s_t = se3.inverse(T_root_s) @ T_root_t
            p_s = se3.apply(T_s_t, p_t) + rng.normal(0, sigma, p_t.shape)
            edges.append(SensorTargetEdge(s, k, Points(p_t, p_s, sigma)))
    return edges, T_root, T_board


class Points:
    """Measured points as one residual."""

    block = 3

    def __init__(self, p_t, p_s, sigma):
        self.parts = [PointResidual(a, b, np.eye(3) / sigma) for a, b in zip(p_t, p_s, strict=True)]
        self.dof = 3 * len(p_t)

    def __call__(self, T_s_t):
        return PointResidual.stack(self.parts)(np.tile(T_s_t, (len(self.parts), 1, 1)))


@pytest.mark.parametrize("seed", range(5))
def test_identity_for_all_is_start_enough_where_points_say_where_they_are(seed):
    edges, T_root, T_board = rig_of_points(np.random.default_rng(seed))
    start = dict.fromkeys(T_root, np.eye(4)), dict.fromkeys(T_board, np.eye(4))
    sensors, boards, _ = solve(edges, *start, FIXED)
    for name, T in T_root.items():
        xi = se3.log(se3.inverse(T) @ sensors[name])
        assert np.linalg.norm(xi) < 5e-3
    near, *_ = solve(edges, T_root, T_board, FIXED)
    for name in T_root:
        np.testing.assert_allclose(sensors[name], near[name], atol=1e-9)
    assert set(boards) == set(T_board)


def test_robust_start_is_not_dragged_away_by_outliers():
    rng = np.random.default_rng(3)
    edges, T_root, T_board = rig_of_points(rng)
    for edge in edges[::6]:
        wrong = [
            PointResidual(part.p_t, part.p_s + rng.normal(0, 0.3, 3), part.W)
            for part in edge.residual.parts
        ]
        edge.residual.parts[:] = wrong
    off = {s: T if s == "s0" else T @ se3.exp(rng.normal(0, 0.05, 6)) for s, T in T_root.items()}
    sensors, *_ = solve_robust(edges, off, T_board, FIXED)
    squares, *_ = solve(edges, off, T_board, FIXED)
    for name in ("s1", "s2"):
        robust, plain = (
            np.linalg.norm(se3.log(se3.inverse(T_root[name]) @ found[name]))
            for found in (sensors, squares)
        )
        assert robust < 3e-3 < 0.01 < plain


def test_what_planes_leave_open_stays_where_it_was():
    rng = np.random.default_rng(0)
    T_root = {"s0": np.eye(4), "s1": se3.exp(rng.normal(0, 0.4, 6))}
    T_board = {str(k): se3.exp(rng.normal(0, 0.5, 6)) for k in range(10)}
    edges = []
    for s, T_root_s in T_root.items():
        for k, T_root_t in T_board.items():
            T_s_t = se3.inverse(T_root_s) @ T_root_t
            n, d = T_s_t[:3, 2], -float(T_s_t[:3, 2] @ T_s_t[:3, 3])
            normal = np.linalg.svd(np.append(n, d)[None])[2][1:]
            edges.append(SensorTargetEdge(s, k, PlaneResidual(1e3 * normal)))
    off = {"s0": np.eye(4), "s1": T_root["s1"] @ se3.exp(rng.normal(0, 0.02, 6))}
    sensors, boards, _ = solve(edges, off, T_board, FIXED)
    np.testing.assert_allclose(sensors["s1"], T_root["s1"], atol=1e-8)
    for k, T in T_board.items():
        moved = se3.log(se3.inverse(T) @ boards[k])
        assert np.abs(moved[[2, 3, 4]]).max() < 0.05


class Blind(PoseResidual):
    """A sensor that looks past its targets: a large error that no small motion changes."""

    def __call__(self, T_s_t):
        return np.full(6, 1e4), np.zeros((6, 6))


def test_a_sensor_that_sees_no_target_where_it_is_has_no_pose():
    edges, T_root, T_board = rig_of_points(np.random.default_rng(1))
    edges += [SensorTargetEdge("blind", k, Blind(np.eye(4), np.eye(6))) for k in T_board]
    with pytest.raises(NotConvergedError, match="'blind' has come to, none of its targets"):
        solve(edges, T_root | {"blind": np.eye(4)}, T_board, FIXED)


class Steep(PoseResidual):
    """Its derivative has the wrong sign."""

    def __call__(self, T_s_t):
        r, J = super().__call__(T_s_t)
        return r, -J


class Timid(PoseResidual):
    """Its derivative is far too large, and so its steps are far too small."""

    def __call__(self, T_s_t):
        r, J = super().__call__(T_s_t)
        return r, 50 * J


class Ragged(PoseResidual):
    """Its derivative is lost on the way."""

    def __call__(self, T_s_t):
        r, J = super().__call__(T_s_t)
        return r, J if np.array_equal(T_s_t, np.eye(4)) else np.full((6, 6), np.nan)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (Steep, "no step lowers its error"),
        (Timid, "its steps do not end"),
        (Ragged, "its normal equations have no solution"),
    ],
)
def test_a_minimum_that_is_not_reached_is_an_error(kind, message):
    T = se3.exp(np.array([0.2, 0.1, 0, 0.3, 0, 0]))
    edges = [SensorTargetEdge("s0", k, kind(T, np.eye(6) * 100)) for k in "abc"]
    boards = dict.fromkeys("abc", np.eye(4))
    with pytest.raises(NotConvergedError, match=f"did not converge: {message}"):
        solve(edges, {"s0": np.eye(4)}, boards, FIXED)
