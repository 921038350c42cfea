"""Edges of the graph: one family, with the sensor's residual as data."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.plugin.contract import Residual


@dataclass(frozen=True, eq=False)
class SensorTargetEdge:
    """What one sensor saw of the target in one exposure.

    The residual depends on `T_s_t = T_root_s^-1 T_root_t` only. `keep` (blocks,) masks blocks that
    are outliers; `scale` divides the whitened residual: the sensor's noise over the configured one.
    """

    sensor: str
    exposure: str
    residual: Residual
    scale: float = 1.0
    keep: NDArray[np.bool_] | None = field(default=None)

    def evaluate(self, T_root_s: Array, T_root_t: Array) -> tuple[Array, Array, Array]:
        """r (m,), J_s (m, 6), J_t (m, 6): right perturbations of `T_root_s` and `T_root_t`.

        `T_s_t` moves by the target's perturbation as it is, and by the sensor's through the
        adjoint: `exp(-xi) T_s_t = T_s_t exp(-adjoint(T_t_s) xi)`.
        """
        T_s_t = se3.inverse(T_root_s) @ T_root_t
        r, J = self.residual(T_s_t)
        if self.keep is not None:
            rows = np.repeat(self.keep, self.residual.block)
            r, J = r[rows], J[rows]
        r, J = r / self.scale, J / self.scale
        return r, -J @ se3.adjoint(se3.inverse(T_s_t)), J

    @property
    def rows(self) -> int:
        """Rows of the residual."""
        blocks = self.residual.dof if self.keep is None else self.keep.sum() * self.residual.block
        return int(blocks)


def huber_weights(r: Array, block: int, k: float) -> Array:
    """(m,) square roots of Huber's weights, one weight per block of rows (Huber 1964)."""
    norm = np.linalg.norm(r.reshape(-1, block), axis=1) / np.sqrt(block)
    weight = np.sqrt(np.minimum(1.0, k / np.maximum(norm, 1e-12)))
    result: Array = np.repeat(weight, block)
    return result
