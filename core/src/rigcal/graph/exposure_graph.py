"""The edges in metres of one exposure of MSG-Cal's graph.

All have one form: points p of frame b, seen from frame a, should be at q, or in the plane z = 0 of
a:

    e = T_root_a^-1 T_root_b p_b - q_a

A sensor-observation edge has the sensor as a and its node as b, and says where the points were
seen. An observation-observation edge has two nodes (`Relation`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.nodes import ObservationNode, Relation


@dataclass(frozen=True, eq=False)
class ExposureGraph:
    """The observation nodes of one exposure and the edges in metres among them."""

    exposure: str
    nodes: tuple[ObservationNode, ...]
    relations: tuple[Relation, ...]


@dataclass(frozen=True, eq=False)
class EdgeRows:
    """The edges of one exposure, one entry per point, over its sensors and then its nodes.

    a, b (N,) index the poses, p_b, q_a (N, 3); `used` (3 N,) are the rows that are errors.
    """

    a: NDArray[np.int64]
    b: NDArray[np.int64]
    p_b: Array
    q_a: Array
    used: NDArray[np.bool_]

    @staticmethod
    def of(x: ExposureGraph) -> EdgeRows:
        """Poses count from the sensor of the first node to that of the last, then the nodes."""
        n = len(x.nodes)
        parts = [
            (i, n + i, node.points, se3.apply(node.T_s_o, node.points), False)
            for i, node in enumerate(x.nodes)
        ]
        parts += [(n + r.a, n + r.b, r.p_b, r.q_a, r.planar) for r in x.relations]
        counts = [len(part[2]) for part in parts]
        a, b = (np.repeat([part[i] for part in parts], counts) for i in (0, 1))
        planar = np.repeat([part[4] for part in parts], counts)
        used = np.repeat(~planar[:, None], 3, axis=1)
        used[:, 2] = True
        p_b, q_a = (np.concatenate([part[i] for part in parts]) for i in (2, 3))
        return EdgeRows(a, b, p_b, q_a, used.reshape(-1))

    def evaluate(self, T: Array, *, jacobian: bool = True) -> tuple[Array, Array]:
        """e (m,) in metres and J (m, n, 6) by right perturbations of the poses T (n, 4, 4)."""
        R_a, t_a = T[self.a, :3, :3], T[self.a, :3, 3]
        R_b, t_b = T[self.b, :3, :3], T[self.b, :3, 3]
        x = np.einsum("nij,nj->ni", R_b, self.p_b) + t_b - t_a
        p_a = np.einsum("nji,nj->ni", R_a, x)
        e = (p_a - self.q_a).reshape(-1)[self.used]
        if not jacobian:
            return e, np.zeros((0, 0, 6))
        R_a_b = np.swapaxes(R_a, 1, 2) @ R_b
        J = np.zeros((len(self.a), 3, len(T), 6))
        i = np.arange(len(self.a))
        J[i, :, self.a, :3], J[i, :, self.a, 3:] = se3.skew(p_a), -np.eye(3)
        J[i, :, self.b, :3], J[i, :, self.b, 3:] = -R_a_b @ se3.skew(self.p_b), R_a_b
        return e, J.reshape(-1, len(T), 6)[self.used]
