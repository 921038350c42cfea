"""Flat surfaces, plain or with a picture on them, and boards that are bent."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.bend import range_to_bend
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import half_planes, inside_convex, plane_of_target


@dataclass(frozen=True, eq=False)
class BentBoard:
    """A board with a bend (3,), see `rigcal.geometry.bend`; `outline` (K, 2) as seen along z."""

    T_w_f: Array
    outline: Array
    bend: Array

    @cached_property
    def bounds(self) -> tuple[Array, float]:
        """See `Shape`."""
        flat = np.pad(self.outline, ((0, 0), (0, 1)))
        rise = float(np.abs(self.bend).sum() * np.sum(self.outline**2, axis=1).max())
        center = flat.mean(axis=0)
        radius = float(np.linalg.norm(flat - center, axis=1).max())
        return se3.apply(self.T_w_f, center), radius + rise

    def meet(self, p_w: Array, d_w: Array, limit: Array) -> Array:
        """See `Shape`."""
        R = self.T_w_f[:3, :3]
        p_f, d_f = (p_w - self.T_w_f[:3, 3]) @ R, d_w @ R
        t = range_to_bend(p_f, d_f, self.bend)
        ahead = np.isfinite(t) & (t > 0) & (t < limit)
        end = p_f + np.where(ahead, t, 0.0)[:, None] * d_f
        return np.where(ahead & inside_convex(end[:, :2], self.outline), t, np.inf)


@dataclass(frozen=True, eq=False)
class Surface:
    """A flat convex polygon: `polygon` (K, 2) anticlockwise in its own frame f (z = 0), metres.

    `grey` in [0, 1] is what a camera sees of it, or `texture` (H, W): a grey picture stretched
    over the polygon's bounding box, row 0 at its top (largest y), column 0 at its left.
    """

    T_w_f: Array
    polygon: Array
    grey: float = 0.5
    texture: NDArray[np.uint8] | None = None

    @cached_property
    def bounds(self) -> tuple[Array, float]:
        """See `Shape`."""
        center = self.polygon.mean(axis=0)
        radius = float(np.linalg.norm(self.polygon - center, axis=1).max())
        return se3.apply(self.T_w_f, np.append(center, 0.0)), radius

    @cached_property
    def _sides(self) -> tuple[Array, Array]:
        """Normals (K, 3) and offsets (K,) in w of the planes through the sides, across the face."""
        outward, offsets = half_planes(self.polygon)
        normals = outward @ self.T_w_f[:3, :2].T
        return normals, offsets + normals @ self.T_w_f[:3, 3]

    def meet(self, p_w: Array, d_w: Array, limit: Array) -> Array:
        """See `Shape`. `t = -(n . p0 + d) / (n . rho)` (eq. 4.12 of the seed, MSG-Cal)."""
        n, d = plane_of_target(self.T_w_f)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = -(p_w @ n + d) / (d_w @ n)
        ahead = np.flatnonzero((t > 0) & (t < limit))
        end = t[ahead, None] * d_w[ahead] + (p_w[ahead] if p_w.ndim == 2 else p_w)
        normals, offsets = self._sides
        ahead = ahead[np.all(normals @ end.T <= offsets[:, None], axis=0)]
        ranges = np.full(len(d_w), np.inf)
        ranges[ahead] = t[ahead]
        return ranges

    def greys(self, p_f: Array, footprint_m: Array | float) -> Array:
        """See `GreyShape`. At least one texel is averaged, which is bilinear interpolation."""
        if self.texture is None:
            return np.full(len(p_f), self.grey)
        low, high = self.polygon.min(axis=0), self.polygon.max(axis=0)
        count = np.array(self.texture.shape[::-1])
        texel = (high - low) / count
        at = (p_f[:, :2] - low) / texel
        at[:, 1] = count[1] - at[:, 1]
        half = np.maximum(np.reshape(footprint_m, (-1, 1)) / texel, 1.0) / 2
        return _mean_in_boxes(self._sums, at - half, at + half) / 255

    @cached_property
    def _sums(self) -> Array:
        """(H + 1, W + 1) sums of the texels above and left of each corner of a texel."""
        assert self.texture is not None
        height, width = self.texture.shape
        sums = np.zeros((height + 1, width + 1))
        np.cumsum(np.cumsum(self.texture, axis=0, dtype=np.float64), axis=1, out=sums[1:, 1:])
        return sums


def _mean_in_boxes(sums: Array, low: Array, high: Array) -> Array:
    """Mean grey (N,) in boxes from corners `low` to `high` (N, 2), (column, row) in texels.

    What reaches over the picture's border is left out. Summed-area tables: Crow, 1984.
    """
    limit = np.array(sums.shape[::-1]) - 1.0
    low = np.clip(low, 0.0, limit - 1e-6)
    high = np.maximum(np.clip(high, 0.0, limit), low + 1e-6)
    (x0, y0), (x1, y1) = low.T, high.T
    total = _sum_at(sums, x1, y1) - _sum_at(sums, x0, y1)
    total += _sum_at(sums, x0, y0) - _sum_at(sums, x1, y0)
    result: Array = total / np.prod(high - low, axis=1)
    return result


def _sum_at(sums: Array, x: Array, y: Array) -> Array:
    """(N,) sums left of x and above y, exact between the corners of texels too."""
    i = np.minimum(y.astype(np.intp), sums.shape[0] - 2)
    j = np.minimum(x.astype(np.intp), sums.shape[1] - 2)
    v, u = y - i, x - j
    above = sums[i, j] * (1 - u) + sums[i, j + 1] * u
    below = sums[i + 1, j] * (1 - u) + sums[i + 1, j + 1] * u
    result: Array = above * (1 - v) + below * v
    return result
