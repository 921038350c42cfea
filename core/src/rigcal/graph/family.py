"""Edges of one sensor, evaluated by one call; what is wrong where a residual breaks its contract.

Time is spent on entering Python, not on arithmetic: 200 views one by one take ten times as long.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from rigcal.errors import ObservationError, PluginError
from rigcal.geometry.se3 import Array
from rigcal.graph.edge import SensorTargetEdge
from rigcal.plugin.answers import check_residual
from rigcal.plugin.contract import Residual, Stacked
from rigcal.plugin.refinable import Refined


class Family:
    """K edges of one sensor with residuals of one class.

    They depend on P `numbers` of the sensor beside the pose, 0 for most.
    """

    def __init__(self, edges: Sequence[SensorTargetEdge], numbers: int = 0) -> None:
        self._edges = edges
        self.sensor = edges[0].sensor
        residuals = [e.residual for e in edges]
        self._numbers = numbers
        self._call = _refined(residuals, numbers) if numbers else _of_pose(_stacked(residuals))
        self._block = edges[0].residual.block
        self._rows = np.array([e.residual.dof for e in edges])
        self._ends = np.concatenate([[0], np.cumsum(self._rows)])
        self._weights = np.concatenate([e.weights for e in edges])

    def normal_equations(self, T_s_t: Array, values: Array, huber_k: float) -> Array:
        """(K, 7 + P, 7 + P) `[J, r]^T [J, r]` at `T_s_t` (K, 4, 4) and numbers of `values` (P,).

        The last entry is replaced by the loss.
        """
        r, J = self._evaluate(T_s_t, values)
        if np.isinf(huber_k):
            return self._products(np.column_stack([J, r]))
        size = _sizes(r, self._block)
        weight = np.minimum(1.0, huber_k / np.maximum(size, 1e-12))
        # Huber (1964): s^2 within k, 2 k s - k^2 beyond.
        loss = np.where(weight < 1, 2 * huber_k * size - huber_k**2, size**2)
        root = np.repeat(np.sqrt(weight), self._block)
        result = self._products(root[:, None] * np.column_stack([J, r]))
        sums = np.concatenate([[0.0], np.cumsum(np.repeat(loss, self._block))])
        result[:, -1, -1] = sums[self._ends[1:]] - sums[self._ends[:-1]]
        return result

    def sizes(self, T_s_t: Array, values: Array) -> list[Array]:
        """Per edge, the rms (blocks,) of every block of rows, in sigmas."""
        sizes = _sizes(self._evaluate(T_s_t, values)[0], self._block)
        return np.split(sizes, self._ends[1:-1] // self._block)

    def check(self, T_s_t: Array, values: Array) -> None:
        """PluginError unless all values are finite."""
        r, J = self._evaluate(T_s_t, values)
        if not (np.isfinite(r).all() and np.isfinite(J).all()):
            raise self._fault(T_s_t)

    def _products(self, A: Array) -> Array:
        """(K, n, n) `A^T A` of every edge's rows of A (N, n)."""
        if (self._rows == self._rows[0]).all():
            A = A.reshape(len(self._rows), -1, A.shape[1])
            result: Array = np.swapaxes(A, 1, 2) @ A
            return result
        parts = [A[a:b] for a, b in pairwise(self._ends.tolist())]
        return np.stack([part.T @ part for part in parts])

    def _evaluate(self, T_s_t: Array, values: Array) -> tuple[Array, Array]:
        """Weighted r (N,) and J (N, 6 + P)."""
        try:
            r, J = self._call(T_s_t, values)
        except (Exception, SystemExit) as error:
            raise self._fault(T_s_t) from error
        if r.shape != self._weights.shape or J.shape != (len(r), 6 + self._numbers):
            raise self._fault(T_s_t)
        return self._weights * r, self._weights[:, None] * J

    def _fault(self, T_s_t: Array) -> PluginError:
        """What is wrong, found edge by edge."""
        for edge, T in zip(self._edges, T_s_t, strict=True):
            if problem := _problem(edge.residual, T):
                return PluginError(
                    f"sensor '{edge.sensor}', exposure '{edge.exposure}': {problem} "
                    f"({_name(edge.residual)}); its plugin needs mending"
                )
        edge = self._edges[0]
        how = "refined" if self._numbers else "stack"
        return PluginError(
            f"sensor '{edge.sensor}': `{how}` of its residual ({_name(edge.residual)}) does not "
            "return what the residuals return one by one; its plugin needs mending"
        )


def _sizes(r: Array, block: int) -> Array:
    result: Array = np.linalg.norm(r.reshape(-1, block), axis=1) / np.sqrt(block)
    return result


def _of_pose(stacked: Stacked) -> Callable[[Array, Array], tuple[Array, Array]]:
    return lambda T_s_t, values: stacked(T_s_t)


def _refined(
    residuals: Sequence[Residual], numbers: int
) -> Callable[[Array, Array], tuple[Array, Array]]:
    """r (N,) and J (N, 6 + P); residuals without `refined` do not depend on the numbers."""
    kind: Any = type(residuals[0])
    if not hasattr(kind, "refined"):
        stacked = _stacked(residuals)

        def held(T_s_t: Array, values: Array) -> tuple[Array, Array]:
            r, J = stacked(T_s_t)
            return r, np.concatenate([J, np.zeros((len(J), numbers))], axis=1)

        return held
    refined: Refined = kind.refined(residuals)

    def evaluate(T_s_t: Array, values: Array) -> tuple[Array, Array]:
        r, J, J_values = refined(T_s_t, values)
        return r, np.concatenate([J, J_values], axis=1)

    return evaluate


def _stacked(residuals: Sequence[Residual]) -> Stacked:
    # A class that inherits `stack` may evaluate otherwise: only one of its own counts.
    kind: Any = type(residuals[0])
    if "stack" in vars(kind):
        stacked: Stacked = kind.stack(residuals)
        return stacked

    def one_by_one(T_s_t: Array) -> tuple[Array, Array]:
        parts = [f(T) for f, T in zip(residuals, T_s_t, strict=True)]
        if any(len(r) != f.dof for (r, _), f in zip(parts, residuals, strict=True)):
            raise ValueError("rows")
        return np.concatenate([r for r, _ in parts]), np.concatenate([J for _, J in parts])

    return one_by_one


def _problem(residual: Residual, T_s_t: Array) -> str:
    """How a residual breaks its contract at `T_s_t`; empty if it keeps it."""
    try:
        check_residual(residual, *residual(T_s_t))
    except ObservationError as error:
        return str(error)
    except (Exception, SystemExit) as error:
        return f"it failed with {type(error).__name__}: {error}"
    return ""


def _name(residual: Residual) -> str:
    kind = type(residual)
    return f"{kind.__module__}.{kind.__qualname__}"
