"""One step of Gauss-Newton: the linear system of a graph, solved by GTSAM."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.numbers import Numbers
from rigcal.graph.stack import Blocks, Index

# Information (1 / variance) so weak that it leaves alone what the data know, and closes what they
# leave open: the place and turn in its own plane of a target of which only planes were seen.
_OPEN = 1 / np.array([3.0, 3.0, 3.0, 10.0, 10.0, 10.0]) ** 2
# The same for numbers, in units.
_OPEN_NUMBER = 1 / 30.0**2


class LinearSystem:
    """Edges between sensors, of which some are `free` (S,), and `exposures` targets.

    `sensor` and `exposure` (E,) number the ends of every edge. What is estimated beside the poses
    is one variable, of all `numbers`. `held` (6,) is information by which every sensor is tied to
    an anchor.
    """

    def __init__(
        self,
        sensor: Index,
        exposure: Index,
        free: NDArray[np.bool_],
        exposures: int,
        numbers: Numbers,
        held: Array,
    ) -> None:
        import gtsam

        self._gtsam: Any = gtsam
        self._sensor, self._exposure, self._free = sensor, exposure, free
        self._movable: list[int] = np.flatnonzero(free).tolist()
        self._keys_s = [gtsam.symbol("s", i) for i in range(len(free))]
        self._keys_t = [gtsam.symbol("t", i) for i in range(exposures)]
        self._key_n = gtsam.symbol("n", 0)
        self._known, self._held = numbers.known, held
        # Targets first: each touches few sensors, which leaves a dense system of the sensors alone.
        self._ordering = gtsam.Ordering()
        for key in [*self._keys_t, *(self._keys_s[i] for i in self._movable)]:
            self._ordering.push_back(key)
        if len(numbers):
            self._ordering.push_back(self._key_n)

    def solve(
        self, blocks: Blocks, T_s_t: Array, numbers: Numbers, off_anchor: Array, damping: float
    ) -> tuple[Array, Array, Array, float]:
        """Steps of sensors (S, 6), targets (K, 6) and numbers (Q,); the fall of chi2 they promise.

        Right perturbations, and numbers in units. `T_s_t` moves by the target's perturbation as it
        is, and by the sensor's through the adjoint: `exp(-xi) T_s_t = T_s_t exp(-adjoint(T_t_s)
        xi)`. `off_anchor` (S, 6) is how far the sensors are from their anchors, in standard
        deviations. `damping` times its diagonal is added to the information.
        """
        A = se3.adjoint(se3.inverse(T_s_t))
        H, g = blocks.H[:, :6, :6], blocks.g[:, :6]
        H_sy = -np.swapaxes(A, 1, 2) @ blocks.H[:, :6]
        H_ss = -H_sy[:, :, :6] @ A
        g_s = -np.einsum("eji,ej->ei", A, g)
        g_n = blocks.g[:, 6:].sum(axis=0) + self._known * numbers.off_start
        more_s = self._more(H_ss, self._sensor, len(self._keys_s), damping)
        more_t = self._more(H, self._exposure, len(self._keys_t), damping)
        own = np.diagonal(blocks.H[:, 6:, 6:], axis1=1, axis2=2).sum(axis=0)
        more_n = damping * own + _OPEN_NUMBER
        graph = self._graph(H_ss, H_sy, g_s, blocks)
        pull_s, pull_n = np.sqrt(self._held) * off_anchor, self._known * numbers.off_start
        self._hold(graph, more_s, pull_s, more_t, more_n, pull_n)
        # Sequential, not multifrontal: half the time here, and one thread gives the same bytes.
        solution = graph.eliminateSequential(self._ordering).optimize()
        step_s, step_t = np.zeros((len(self._keys_s), 6)), np.zeros((len(self._keys_t), 6))
        for i in self._movable:
            step_s[i] = solution.at(self._keys_s[i])
        for i, key in enumerate(self._keys_t):
            step_t[i] = solution.at(key)
        step_n = np.asarray(solution.at(self._key_n)) if len(g_n) else np.zeros(0)
        descent = -np.sum(g_s * step_s[self._sensor]) - np.sum(g * step_t[self._exposure])
        promised = descent + np.sum(more_s * step_s**2) + np.sum(more_t * step_t**2)
        promised += more_n @ step_n**2 - g_n @ step_n - np.sum(pull_s * step_s)
        return step_s, step_t, step_n, float(promised)

    def _more(self, H: Array, ends: Index, count: int, damping: float) -> Array:
        """(count, 6) what is added to the information's diagonal."""
        diagonal = np.zeros((count, 6))
        np.add.at(diagonal, ends, np.diagonal(H, axis1=1, axis2=2))
        return damping * diagonal + _OPEN

    def _graph(self, H_ss: Array, H_sy: Array, g_s: Array, blocks: Blocks) -> Any:
        """One Hessian factor per edge."""
        factor, graph = self._gtsam.HessianFactor, self._gtsam.GaussianFactorGraph()
        H_st, H_sn, H_nn = H_sy[:, :, :6], H_sy[:, :, 6:], blocks.H[:, 6:, 6:]
        has_numbers = np.any(H_nn, axis=(1, 2))
        for e, (i, k) in enumerate(zip(self._sensor, self._exposure, strict=True)):
            H, g = blocks.H[e, :6, :6], -blocks.g[e, :6]
            ends: list[Any] = [self._keys_t[k]]
            parts: list[Any] = [H, g]
            if has_numbers[e]:
                ends.append(self._key_n)
                parts = [H, blocks.H[e, :6, 6:], g, H_nn[e], -blocks.g[e, 6:]]
            if self._free[i]:
                ends.insert(0, self._keys_s[i])
                rows = [H_ss[e], H_st[e], *([H_sn[e]] if has_numbers[e] else []), -g_s[e]]
                parts = [*rows, *parts]
            graph.push_back(factor(*ends, *parts, 0.0))
        return graph

    def _hold(
        self,
        graph: Any,
        more_s: Array,
        pull_s: Array,
        more_t: Array,
        more_n: Array,
        pull_n: Array,
    ) -> None:
        """One factor per variable: what is added, anchors, and what is known of the numbers."""
        factor, zero = self._gtsam.HessianFactor, np.zeros(6)
        for i in self._movable:
            H = np.diag(more_s[i] + self._held)
            graph.push_back(factor(self._keys_s[i], H, -pull_s[i], 0.0))
        for key, more in zip(self._keys_t, more_t, strict=True):
            graph.push_back(factor(key, np.diag(more), zero, 0.0))
        if len(more_n):
            graph.push_back(factor(self._key_n, np.diag(more_n + self._known), -pull_n, 0.0))
