"""The target and all that stands around it, and the rays that meet it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.scene.shapes import Cylinder, GreyShape, Shape, Sphere
from rigcal.scene.surface import BentBoard, Surface
from rigcal.targets.target import Target


@dataclass(frozen=True, eq=False)
class Scene:
    """The target at `T_w_t` (None: no target in sight), and everything else that stands around."""

    target: Target
    T_w_t: Array | None
    surfaces: tuple[Surface, ...] = ()
    solids: tuple[Cylinder | Sphere, ...] = ()

    @property
    def shapes(self) -> tuple[GreyShape, ...]:
        """All but the target: the surfaces, then the solids."""
        return (*self.surfaces, *self.solids)

    def cast(self, p_w: Array, d_w: Array) -> tuple[Array, NDArray[np.int64]]:
        """First hits of rays from (N, 3) or (3,) origins along (N, 3) unit directions.

        Returns range (N,) in metres, inf where nothing is hit, and what was hit (N,): 0 the
        target, i + 1 `shapes[i]`, -1 nothing. Hits behind the origin (t <= 0) are none.
        """
        ranges = np.full(len(d_w), np.inf)
        hit = np.full(len(d_w), -1, dtype=np.int64)
        if len(d_w) == 0:
            return ranges, hit
        shapes: list[tuple[int, Shape]] = list(enumerate(self.shapes, start=1))
        if self.T_w_t is not None:
            shapes.insert(0, (0, self._board(self.T_w_t)))
        origins = np.atleast_2d(p_w)
        middle = origins.mean(axis=0)
        spread = float(np.sqrt(np.sum((origins - middle) ** 2, axis=1).max()))
        for index, shape in shapes:
            rays = _rays_near(shape, middle, spread, d_w)
            start = p_w if p_w.ndim == 1 else p_w[rays]
            t = shape.meet(start, d_w[rays], ranges[rays])
            met = np.isfinite(t)
            ranges[rays] = np.where(met, t, ranges[rays])
            hit[rays] = np.where(met, index, hit[rays])
        return ranges, hit

    def _board(self, T_w_t: Array) -> Shape:
        outline, bend = self.target.outline, self.target.bend
        return BentBoard(T_w_t, outline, bend) if bend.any() else Surface(T_w_t, outline)

    def greys(self, p_w: Array, hit: NDArray[np.int64], footprint_m: Array | float = 0.0) -> Array:
        """Grey (N,) in [0, 1] of what `cast` hit at points (N, 3); NaN for the target and nothing.

        `footprint_m`, one or (N,), is the side of the square that a textured surface is averaged
        over: what a pixel covers of it.
        """
        greys = np.full(len(hit), np.nan)
        footprint = np.broadcast_to(footprint_m, hit.shape)
        for index, shape in enumerate(self.shapes, start=1):
            here = np.flatnonzero(hit == index)
            p_f = se3.apply(se3.inverse(shape.T_w_f), p_w[here])
            greys[here] = shape.greys(p_f, footprint[here])
        return greys


def _rays_near(shape: Shape, middle: Array, spread: float, d_w: Array) -> NDArray[np.intp] | slice:
    """The rays that meet the sphere around a shape, and perhaps a few more.

    Rays that start up to `spread` (m) off `middle` are taken as from there, to a larger sphere.
    """
    center, radius = shape.bounds
    away = center - middle
    beyond = float(away @ away) - (radius * (1 + 1e-9) + spread + 1e-9) ** 2
    if beyond <= 0:
        return slice(None)
    return np.flatnonzero(d_w @ away >= np.sqrt(beyond))
