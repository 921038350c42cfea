"""Edges evaluated together: the same as one by one, and a named error for a broken residual."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from rigcal.errors import PluginError
from rigcal.geometry import se3
from rigcal.graph.edge import SensorTargetEdge
from rigcal.graph.joint import solve
from rigcal.graph.stack import EdgeStack
from rigcal.residual import PlaneResidual, PointResidual, PoseResidual


@dataclass(frozen=True, eq=False)
class Single:
    """A residual without `stack`, of `count` points."""

    p_s: np.ndarray
    block: int = 3

    @property
    def dof(self):
        return self.p_s.size

    def __call__(self, T_s_t):
        p_t = np.arange(self.p_s.size).reshape(-1, 3) / 7
        R = T_s_t[:3, :3]
        J = np.concatenate([-R @ se3.skew(p_t), np.broadcast_to(R, (len(p_t), 3, 3))], axis=2)
        return (se3.apply(T_s_t, p_t) - self.p_s).reshape(-1), J.reshape(-1, 6)


class Bent(PlaneResidual):
    """Inherits `stack`, but evaluates otherwise."""

    def __call__(self, T_s_t):
        r, J = super().__call__(T_s_t)
        return 2 * r, 2 * J


def residuals(rng):
    return {
        "plane": [PlaneResidual(rng.normal(size=(3, 4))) for _ in range(5)],
        "scan": [PlaneResidual(rng.normal(size=(2, 4)), planar=i > 1) for i in range(5)],
        "pose": [PoseResidual(poses(rng, 1)[0], rng.normal(size=(6, 6))) for _ in range(5)],
        "point": [PointResidual(*rng.normal(size=(2, 3)), rng.normal(size=(3, 3)))] * 5,
        "single": [Single(rng.normal(size=(n, 3))) for n in (2, 4, 4, 1, 6)],
        "bent": [Bent(rng.normal(size=(3, 4))) for _ in range(5)],
    }


def poses(rng, count):
    return se3.exp(rng.normal(0, 0.7, (count, 6)))


def edges_of(rng):
    """Edges of all kinds, mixed, one sensor of each kind and five exposures."""
    edges = [
        SensorTargetEdge(kind, str(k), residual, scale=rng.uniform(0.5, 2))
        for kind, own in residuals(rng).items()
        for k, residual in enumerate(own)
    ]
    edges = [
        replace(e, keep=rng.uniform(size=e.residual.dof // 3) > 0.3) if e.sensor == "single" else e
        for e in edges
    ]
    return [edges[i] for i in rng.permutation(len(edges))]


def brute(edge, T_s_t, huber_k):
    r, J = edge.residual(T_s_t)
    w = np.full(len(r), 1 / edge.scale)
    if edge.keep is not None:
        w *= np.repeat(edge.keep, edge.residual.block)
    r, J = w * r, w[:, None] * J
    H, g, loss = np.zeros((6, 6)), np.zeros(6), 0.0
    for rows in np.split(np.arange(len(r)), len(r) // edge.residual.block):
        s = np.sqrt(np.mean(r[rows] ** 2))
        far = s > huber_k
        H += J[rows].T @ J[rows] * (huber_k / s if far else 1)
        g += J[rows].T @ r[rows] * (huber_k / s if far else 1)
        loss += len(rows) * (2 * huber_k * s - huber_k**2 if far else s**2)
    return H, g, loss


@pytest.mark.parametrize("huber_k", [np.inf, 0.5])
def test_all_edges_at_once_are_the_edges_one_by_one(huber_k):
    rng = np.random.default_rng(0)
    edges = edges_of(rng)
    sensors = {name: poses(rng, 1)[0] for name in residuals(rng)}
    targets = {str(k): poses(rng, 1)[0] for k in range(5)}
    stack = EdgeStack(edges, list(sensors), list(targets))
    T_s_t = stack.relative(np.stack(list(sensors.values())), np.stack(list(targets.values())))
    blocks = stack.blocks(T_s_t, huber_k)
    for i, edge in enumerate(edges):
        T = np.linalg.inv(sensors[edge.sensor]) @ targets[edge.exposure]
        H, g, loss = brute(edge, T, huber_k)
        np.testing.assert_allclose(blocks.H[i], H, rtol=1e-12, atol=1e-12 * np.abs(H).max())
        np.testing.assert_allclose(blocks.g[i], g, rtol=1e-12, atol=1e-12 * np.abs(H).max())
        assert blocks.chi2[i] == pytest.approx(loss, rel=1e-12)


@pytest.mark.parametrize("kind", ["plane", "scan", "pose", "point"])
def test_stack_of_the_default_residuals_is_each_of_them(kind):
    rng = np.random.default_rng(1)
    own = residuals(rng)[kind]
    T = poses(rng, len(own))
    r, J = type(own[0]).stack(own)(T)
    one_by_one = [f(pose) for f, pose in zip(own, T, strict=True)]
    np.testing.assert_allclose(r, np.concatenate([r for r, _ in one_by_one]), rtol=1e-12)
    np.testing.assert_allclose(J, np.concatenate([J for _, J in one_by_one]), rtol=1e-12)


class Broken(Single):
    """Fails in exposure 2 only."""

    def __init__(self, rows, fault):
        super().__init__(np.ones((rows, 3)))
        object.__setattr__(self, "fault", fault)

    def __call__(self, T_s_t):
        r, J = super().__call__(T_s_t)
        match self.fault:
            case "rows":
                return r[:-1], J[:-1]
            case "columns":
                return r, J[:, :5]
            case "nan":
                return r, np.where(np.arange(6) == 2, np.nan, J)
            case "raises":
                raise ZeroDivisionError("range is 0")
        return r, J


class BrokenStack(Single):
    @classmethod
    def stack(cls, residuals):
        return lambda T_s_t: (np.zeros(4), np.zeros((4, 6)))


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("rows", r"shapes \(5,\) and \(5, 6\); expected \(6,\) and \(6, 6\) of its dof 6"),
        ("columns", r"shapes \(6,\) and \(6, 5\); expected \(6,\) and \(6, 6\)"),
        ("nan", r"its Jacobian of shape \(6, 6\) is not finite in 6 of its 36 entries"),
        ("raises", "it failed with ZeroDivisionError: range is 0"),
    ],
)
def test_a_residual_that_breaks_its_contract_is_named(fault, message):
    found = [Broken(2, fault if k == 2 else "") for k in range(4)]
    edges = [SensorTargetEdge("sonar", f"at {k}", r) for k, r in enumerate(found)]
    where = rf"sensor 'sonar', exposure 'at 2': .*{message}.*Broken"
    with pytest.raises(PluginError, match=where):
        solve(edges, {"sonar": np.eye(4)}, {e.exposure: np.eye(4) for e in edges}, frozenset())


def test_a_stack_that_breaks_its_contract_is_named():
    edges = [SensorTargetEdge("sonar", str(k), BrokenStack(np.ones((2, 3)))) for k in range(3)]
    with pytest.raises(PluginError, match=r"sensor 'sonar': `stack` of its residual \(.*Stack\)"):
        solve(edges, {"sonar": np.eye(4)}, {e.exposure: np.eye(4) for e in edges}, frozenset())
