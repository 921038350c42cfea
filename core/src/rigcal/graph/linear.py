"""One step of Gauss-Newton: the linear system of a graph, solved by GTSAM."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.stack import Blocks, Index

# Information (1 / variance) so weak that it leaves alone what the data know, and closes what they
# leave open: the place and turn in its own plane of a target of which only planes were seen.
_OPEN = 1 / np.array([3.0, 3.0, 3.0, 10.0, 10.0, 10.0]) ** 2


class LinearSystem:
    """Edges between sensors, of which some are `free` (S,), and `exposures` targets.

    `sensor` and `exposure` (E,) number the ends of every edge.
    """

    def __init__(
        self, sensor: Index, exposure: Index, free: NDArray[np.bool_], exposures: int
    ) -> None:
        import gtsam

        self._gtsam: Any = gtsam
        self._sensor, self._exposure, self._free = sensor, exposure, free
        self._movable: list[int] = np.flatnonzero(free).tolist()
        self._keys_s = [gtsam.symbol("s", i) for i in range(len(free))]
        self._keys_t = [gtsam.symbol("t", i) for i in range(exposures)]
        # Targets first: each touches few sensors, which leaves a dense system of the sensors alone.
        self._ordering = gtsam.Ordering()
        for key in [*self._keys_t, *(self._keys_s[i] for i in self._movable)]:
            self._ordering.push_back(key)

    def solve(self, blocks: Blocks, T_s_t: Array, damping: float) -> tuple[Array, Array, float]:
        """Steps of the sensors (S, 6) and targets (K, 6), and the fall of chi2 that they promise.

        Right perturbations. `T_s_t` moves by the target's perturbation as it is, and by the
        sensor's through the adjoint: `exp(-xi) T_s_t = T_s_t exp(-adjoint(T_t_s) xi)`. `damping`
        times its diagonal is added to the information.
        """
        A = se3.adjoint(se3.inverse(T_s_t))
        H_st = -np.swapaxes(A, 1, 2) @ blocks.H
        H_ss = -H_st @ A
        g_s = -np.einsum("eji,ej->ei", A, blocks.g)
        more_s = self._more(H_ss, self._sensor, len(self._keys_s), damping)
        more_t = self._more(blocks.H, self._exposure, len(self._keys_t), damping)
        graph = self._graph(H_ss, H_st, g_s, blocks, more_s, more_t)
        # Sequential, not multifrontal: half the time here, and one thread gives the same bytes.
        solution = graph.eliminateSequential(self._ordering).optimize()
        step_s, step_t = np.zeros((len(self._keys_s), 6)), np.zeros((len(self._keys_t), 6))
        for i in self._movable:
            step_s[i] = solution.at(self._keys_s[i])
        for i, key in enumerate(self._keys_t):
            step_t[i] = solution.at(key)
        descent = -np.sum(g_s * step_s[self._sensor]) - np.sum(blocks.g * step_t[self._exposure])
        promised = descent + np.sum(more_s * step_s**2) + np.sum(more_t * step_t**2)
        return step_s, step_t, float(promised)

    def _more(self, H: Array, ends: Index, count: int, damping: float) -> Array:
        """(count, 6) what is added to the information's diagonal."""
        diagonal = np.zeros((count, 6))
        np.add.at(diagonal, ends, np.diagonal(H, axis1=1, axis2=2))
        return damping * diagonal + _OPEN

    def _graph(
        self, H_ss: Array, H_st: Array, g_s: Array, blocks: Blocks, more_s: Array, more_t: Array
    ) -> Any:
        """One Hessian factor per edge, and one per variable that holds what is added."""
        factor, graph = self._gtsam.HessianFactor, self._gtsam.GaussianFactorGraph()
        for e, (i, k) in enumerate(zip(self._sensor, self._exposure, strict=True)):
            H, g = blocks.H[e], -blocks.g[e]
            if self._free[i]:
                ends = self._keys_s[i], self._keys_t[k]
                graph.push_back(factor(*ends, H_ss[e], H_st[e], -g_s[e], H, g, 0.0))
            else:
                graph.push_back(factor(self._keys_t[k], H, g, 0.0))
        zero = np.zeros(6)
        for i in self._movable:
            graph.push_back(factor(self._keys_s[i], np.diag(more_s[i]), zero, 0.0))
        for key, more in zip(self._keys_t, more_t, strict=True):
            graph.push_back(factor(key, np.diag(more), zero, 0.0))
        return graph
