"""The target and all that stands around it, and the rays that meet it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.scene.shapes import Cylinder, Shape, Sphere
from rigcal.scene.surface import Surface
from rigcal.targets.target import Target


@dataclass(frozen=True, eq=False)
class Scene:
    """The target at `T_w_t` (None: no target in sight), and everything else that stands around."""

    target: Target
    T_w_t: Array | None
    surfaces: tuple[Surface, ...] = ()
    solids: tuple[Cylinder | Sphere, ...] = ()

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """All but the target: the surfaces, then the solids."""
        return (*self.surfaces, *self.solids)

    def cast(self, p_w: Array, d_w: Array) -> tuple[Array, NDArray[np.int64]]:
        """First hits of rays from (N, 3) or (3,) origins along (N, 3) unit directions.

        Returns range (N,) in metres, inf where nothing is hit, and what was hit (N,): 0 the
        target, i + 1 `shapes[i]`, -1 nothing. Hits behind the origin (t <= 0) are none.
        """
        ranges = np.full(len(d_w), np.inf)
        hit = np.full(len(d_w), -1, dtype=np.int64)
        shapes: list[tuple[int, Shape]] = list(enumerate(self.shapes, start=1))
        if self.T_w_t is not None:
            shapes.insert(0, (0, Surface(self.T_w_t, self.target.outline)))
        near = _rays_near([shape for _, shape in shapes], p_w, d_w)
        for (index, shape), rays in zip(shapes, near, strict=True):
            d_f = d_w[rays] @ shape.T_w_f[:3, :3]
            start = p_w[rays] if p_w.ndim == 2 else p_w
            t = shape.meet((start - shape.T_w_f[:3, 3]) @ shape.T_w_f[:3, :3], d_f)
            closer = t < ranges[rays]
            ranges[rays[closer]], hit[rays[closer]] = t[closer], index
        return ranges, hit

    def greys(self, p_w: Array, hit: NDArray[np.int64], footprint_m: Array | float = 0.0) -> Array:
        """Grey (N,) in [0, 1] of what `cast` hit at points (N, 3); NaN for the target and nothing.

        `footprint_m`, one or (N,), is the side of the square that a textured surface is averaged
        over: what a pixel covers of it.
        """
        greys = np.full(len(hit), np.nan)
        footprint = np.broadcast_to(footprint_m, hit.shape)
        for index, shape in enumerate(self.shapes, start=1):
            here = np.flatnonzero(hit == index)
            if len(here):
                p_f = se3.apply(se3.inverse(shape.T_w_f), p_w[here])
                greys[here] = shape.greys(p_f, footprint[here])
        return greys


def _rays_near(shapes: Sequence[Shape], p_w: Array, d_w: Array) -> list[NDArray[np.intp]]:
    """For each shape the rays that meet the sphere around it, and perhaps a few more.

    Rays from different origins are taken from the middle of these, and the spheres are the larger
    for it: that costs one matrix product for all shapes.
    """
    if not shapes or not len(d_w):
        return [np.arange(0)] * len(shapes)
    origins = np.atleast_2d(p_w)
    middle = origins.mean(axis=0)
    spread = float(np.linalg.norm(origins - middle, axis=1).max())
    centers = np.array([se3.apply(shape.T_w_f, shape.bounds[0]) for shape in shapes]) - middle
    radii = np.array([shape.bounds[1] for shape in shapes]) * (1 + 1e-9) + spread + 1e-9
    beyond = np.einsum("ki,ki->k", centers, centers) - radii**2
    near = centers @ d_w.T >= np.sqrt(np.maximum(beyond, 0.0))[:, None]
    near[beyond <= 0] = True
    return [np.flatnonzero(rays) for rays in near]
