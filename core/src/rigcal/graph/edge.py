"""Edges of the graph: one family, with the sensor's residual as data."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry.se3 import Array
from rigcal.plugin.contract import Residual


@dataclass(frozen=True, eq=False)
class SensorTargetEdge:
    """What one sensor saw of the target in one exposure.

    The residual depends on `T_s_t = T_root_s^-1 T_root_t` only. `keep` (blocks,) masks blocks that
    are outliers; `scale` divides the whitened residual: the sensor's noise over the configured one.
    `in_plane` is whether it tells where the target is in its own plane.
    """

    sensor: str
    exposure: str
    residual: Residual
    scale: float = 1.0
    keep: NDArray[np.bool_] | None = field(default=None)
    in_plane: bool = True

    @property
    def rows(self) -> int:
        """Rows of the residual that count."""
        rows = self.residual.dof if self.keep is None else self.keep.sum() * self.residual.block
        return int(rows)

    @property
    def weights(self) -> Array:
        """(m,) factors of the residual's rows: 0 where masked, else 1 / scale."""
        if self.keep is None:
            return np.full(self.residual.dof, 1 / self.scale)
        return np.repeat(self.keep, self.residual.block) / self.scale
