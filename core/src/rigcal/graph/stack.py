"""All edges of a graph evaluated together: one block of normal equations per edge."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.edge import SensorTargetEdge
from rigcal.graph.family import Family

Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Blocks:
    """Normal equations of E edges, each in its own `T_s_t` (right perturbation).

    H (E, 6, 6) = J^T J, g (E, 6) = J^T r, and chi2 (E,) = r^T r or the robust loss.
    """

    H: Array
    g: Array
    chi2: Array


class EdgeStack:
    """Edges between `sensors` and `exposures`; `sensor` and `exposure` (E,) number their ends.

    The order of the edges is kept everywhere; what is evaluated by one call is a `Family`.
    """

    def __init__(
        self,
        edges: Sequence[SensorTargetEdge],
        sensors: Sequence[str],
        exposures: Sequence[str],
    ) -> None:
        at_s = {name: i for i, name in enumerate(sensors)}
        at_t = {name: i for i, name in enumerate(exposures)}
        self.sensor: Index = np.array([at_s[e.sensor] for e in edges], dtype=np.int64)
        self.exposure: Index = np.array([at_t[e.exposure] for e in edges], dtype=np.int64)
        members: dict[tuple[str, type, int], list[int]] = {}
        for i, e in enumerate(edges):
            members.setdefault((e.sensor, type(e.residual), e.residual.block), []).append(i)
        self._families = [
            (np.array(own), Family([edges[i] for i in own])) for own in members.values()
        ]

    def relative(self, T_root_s: Array, T_root_t: Array) -> Array:
        """`T_s_t` (E, 4, 4) from the poses of all sensors (S, 4, 4) and exposures (K, 4, 4)."""
        result: Array = se3.inverse(T_root_s)[self.sensor] @ T_root_t[self.exposure]
        return result

    def blocks(self, T_s_t: Array, huber_k: float = np.inf) -> Blocks:
        """Normal equations at `T_s_t` (E, 4, 4), with Huber's loss beyond `huber_k` sigmas.

        PluginError names sensor and exposure if a residual breaks its contract.
        """
        total = np.zeros((len(self.sensor), 7, 7))
        for own, family in self._families:
            total[own] = family.normal_equations(T_s_t[own], huber_k)
        return Blocks(total[:, :6, :6], total[:, :6, 6], total[:, 6, 6])

    def sizes(self, T_s_t: Array) -> list[Array]:
        """Per edge, the rms (blocks,) of every block of rows, in sigmas."""
        result: list[Array] = [np.empty(0)] * len(self.sensor)
        for own, family in self._families:
            for i, sizes in zip(own, family.sizes(T_s_t[own]), strict=True):
                result[i] = sizes
        return result

    def check(self, T_s_t: Array) -> None:
        """PluginError if a residual is not finite at `T_s_t`."""
        for own, family in self._families:
            family.check(T_s_t[own])


def poses_of(poses: Mapping[str, Array]) -> Array:
    """(N, 4, 4) poses by name as one array."""
    return np.array(list(poses.values())).reshape(-1, 4, 4)
