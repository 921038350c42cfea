"""What rays can meet, and the round shapes among it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rigcal.geometry.se3 import Array

_TINY = 1e-15
"""Stands for a direction's component of zero, so that nothing is divided by zero."""


class Shape(Protocol):
    """A thing that rays meet."""

    @property
    def bounds(self) -> tuple[Array, float]:
        """Centre (3,) in w and radius (m) of a sphere that holds it."""
        ...

    def meet(self, p_w: Array, d_w: Array, limit: Array) -> Array:
        """(N,) range (m) of the first hits of rays, 0 < t < `limit` (N,); inf where there is none.

        p_w: origins (3,) or (N, 3); d_w: unit directions (N, 3).
        """
        ...


class GreyShape(Shape, Protocol):
    """A thing at `T_w_f` (4, 4), described in its own frame f, and how cameras see it."""

    @property
    def T_w_f(self) -> Array:
        """(4, 4)."""
        ...

    def greys(self, p_f: Array, footprint_m: Array | float) -> Array:
        """(N,) in [0, 1] at points (N, 3) on it: the mean over squares of side `footprint_m`."""
        ...


@dataclass(frozen=True, eq=False)
class Sphere:
    """A ball of `radius` (m) about the origin of its frame f."""

    T_w_f: Array
    radius: float
    grey: float = 0.5

    @property
    def bounds(self) -> tuple[Array, float]:
        """See `Shape`."""
        return self.T_w_f[:3, 3], self.radius

    def meet(self, p_w: Array, d_w: Array, limit: Array) -> Array:
        """See `Shape`."""
        p_f, d_f = _in_frame(self.T_w_f, p_w, d_w)
        middle = -np.sum(p_f * d_f, axis=1)
        foot = p_f + middle[:, None] * d_f
        square = self.radius**2 - np.einsum("ni,ni->n", foot, foot)
        half = np.sqrt(np.maximum(square, 0.0))
        return _first(middle - half, np.where(square >= 0, middle + half, -np.inf), limit)

    def greys(self, p_f: Array, footprint_m: Array | float) -> Array:
        """See `GreyShape`."""
        return np.full(len(p_f), self.grey)


@dataclass(frozen=True, eq=False)
class Cylinder:
    """A closed cylinder about the z axis of its frame f, from -height / 2 to height / 2 (m)."""

    T_w_f: Array
    radius: float
    height: float
    grey: float = 0.5

    @property
    def bounds(self) -> tuple[Array, float]:
        """See `Shape`."""
        return self.T_w_f[:3, 3], float(np.hypot(self.radius, self.height / 2))

    def meet(self, p_w: Array, d_w: Array, limit: Array) -> Array:
        """See `Shape`. A ray is inside while it is within the mantle and between both ends."""
        p_f, d_f = _in_frame(self.T_w_f, p_w, d_w)
        xy, flat = p_f[..., :2], d_f[:, :2]
        slope = np.maximum(np.linalg.norm(flat, axis=1), _TINY)
        middle = -np.sum(xy * flat, axis=1) / slope**2
        foot = xy + middle[:, None] * flat
        square = self.radius**2 - np.einsum("ni,ni->n", foot, foot)
        half = np.sqrt(np.maximum(square, 0.0)) / slope
        rise = np.where(np.abs(d_f[:, 2]) < _TINY, _TINY, d_f[:, 2])
        ends = (np.array([[-0.5], [0.5]]) * self.height - p_f[..., 2]) / rise
        enter = np.maximum(middle - half, ends.min(axis=0))
        leave = np.minimum(middle + half, ends.max(axis=0))
        return _first(enter, np.where(square >= 0, leave, -np.inf), limit)

    def greys(self, p_f: Array, footprint_m: Array | float) -> Array:
        """See `GreyShape`."""
        return np.full(len(p_f), self.grey)


def _in_frame(T_w_f: Array, p_w: Array, d_w: Array) -> tuple[Array, Array]:
    """Origins (3,) or (N, 3) and directions (N, 3) of rays in frame f."""
    return (p_w - T_w_f[:3, 3]) @ T_w_f[:3, :3], d_w @ T_w_f[:3, :3]


def _first(enter: Array, leave: Array, limit: Array) -> Array:
    """The first t > 0 at which rays cross the rim of a convex body; inf where t >= `limit`."""
    t = np.where(enter > 0, enter, leave)
    return np.where((enter <= leave) & (t > 0) & (t < limit), t, np.inf)
