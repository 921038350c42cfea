"""The simulated world that a sensor plugin's simulator looks at: flat surfaces in frame w."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import inside_convex
from rigcal.targets.target import Target


@dataclass(frozen=True, eq=False)
class Surface:
    """A flat convex polygon: `polygon` (K, 2) anticlockwise in its own frame f (z = 0), metres.

    `grey` in [0, 1] is what a camera sees of it.
    """

    T_w_f: Array
    polygon: Array
    grey: float = 0.5


@dataclass(frozen=True, eq=False)
class Scene:
    """The target at `T_w_t` (None: no target in sight), and everything else that stands around."""

    target: Target
    T_w_t: Array | None
    surfaces: tuple[Surface, ...] = ()

    def cast(self, p_w: Array, d_w: Array) -> tuple[Array, NDArray[np.int64]]:
        """First hits of rays from (N, 3) or (3,) origins along (N, 3) unit directions.

        Returns range (N,) in metres, inf where nothing is hit, and what was hit (N,): 0 the
        target, i + 1 `surfaces[i]`, -1 nothing. `t = -(n . p0 + d) / (n . rho)`, hits with t <= 0
        are behind the ray (eq. 4.12 of the seed, MSG-Cal).
        """
        ranges = np.full(len(d_w), np.inf)
        hit = np.full(len(d_w), -1, dtype=np.int64)
        flats = [(i + 1, s.T_w_f, s.polygon) for i, s in enumerate(self.surfaces)]
        if self.T_w_t is not None:
            flats.insert(0, (0, self.T_w_t, self.target.outline))
        for index, T_w_f, polygon in flats:
            p_f = se3.apply(se3.inverse(T_w_f), p_w)
            with np.errstate(divide="ignore", invalid="ignore"):
                t = -p_f[..., 2] / (d_w @ T_w_f[:3, 2])
            closer = np.flatnonzero((t > 0) & (t < ranges))
            start = p_f[closer, :2] if p_f.ndim == 2 else p_f[:2]
            xy = start + t[closer, None] * (d_w[closer] @ T_w_f[:3, :2])
            closer = closer[inside_convex(xy, polygon)]
            ranges[closer], hit[closer] = t[closer], index
        return ranges, hit
