"""Where candidates are in their sensor's frame, as arrays that compare at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import tangent_basis
from rigcal.observation import (
    Geometry,
    LineGeometry,
    PlaneGeometry,
    PointGeometry,
    PoseGeometry,
)
from rigcal.targets.target import Target

_POINTS = 5
_KINDS: tuple[type, ...] = (PoseGeometry, PlaneGeometry, LineGeometry, PointGeometry)
SLIDE_M = 0.05
"""How far the middle of a surface may shift in itself: other beams meet its ends every time."""


@dataclass(frozen=True, eq=False)
class Places:
    """N candidates of one sensor.

    kind (N,): their geometry. points (N, 5, 3) on the board; reference (N, 5, 3) and projector
    (N, 3, 3): a geometry knows `projector (p - reference)`, which is 0 for points p of the same
    place. center (N, 3). sigma (N,): standard deviation of what it knows, m.
    """

    kind: NDArray[np.int64]
    points: Array
    reference: Array
    projector: Array
    center: Array
    sigma: Array

    def __len__(self) -> int:
        return len(self.kind)

    @property
    def is_pose(self) -> NDArray[np.bool_]:
        """(N,) whose geometry identifies the target, and is no mere surface."""
        return np.asarray(self.kind == _KINDS.index(PoseGeometry), bool)

    def same(
        self, a: NDArray[np.intp], b: NDArray[np.intp], within_m: float, slide_m: float = SLIDE_M
    ) -> NDArray[np.bool_]:
        """(len(a), len(b)) which of a are in the same place as b.

        That is, not farther apart than `within_m` and four standard deviations of noise.
        """
        slide = np.linalg.norm(self.center[a][:, None] - self.center[b][None], axis=-1)
        sigma = np.hypot(self.sigma[a][:, None], self.sigma[b][None])
        alike = self.kind[a][:, None] == self.kind[b][None]
        result: NDArray[np.bool_] = np.asarray(
            alike & (self.apart(a, b) < within_m + 4 * sigma) & (slide < slide_m + 4 * sigma), bool
        )
        return result

    def apart(self, a: NDArray[np.intp], b: NDArray[np.intp]) -> Array:
        """(len(a), len(b)) how far the points of a are from where b says that they are, m."""
        between = self.points[a][:, None] - self.reference[b][None]
        known = np.einsum("bij,abmj->abmi", self.projector[b], between)
        result: Array = np.linalg.norm(known, axis=-1).max(axis=-1)
        return result


def places_of(geometries: Sequence[Geometry], target: Target) -> Places:
    """Where geometries are that stand for a target."""
    rows = [_row(g, target) for g in geometries]
    kinds = np.array([_KINDS.index(type(g)) for g in geometries], dtype=np.int64)
    points, reference, projector, center, sigma = (
        np.array(column, dtype=np.float64).reshape(len(rows), *shape)
        for column, shape in zip(
            zip(*rows, strict=True) if rows else [[]] * 5,
            ((_POINTS, 3), (_POINTS, 3), (3, 3), (3,), ()),
            strict=True,
        )
    )
    return Places(kinds, points, reference, projector, center, sigma)


def _row(g: Geometry, target: Target) -> tuple[Array, Array, Array, Array, float]:
    """points, reference, projector, center, sigma."""
    half = float(np.hypot(*target.size)) / 2
    match g:
        case PoseGeometry():
            corners = _padded(se3.apply(g.T_s_t, target.outline_points))
            variance = _largest(g.covariance[3:, 3:]) + half**2 * _largest(g.covariance[:3, :3])
            return corners, corners, np.eye(3), g.T_s_t[:3, 3], float(np.sqrt(variance))
        case PlaneGeometry():
            B = 0.7 * half * tangent_basis(g.normal).T
            points = np.concatenate([g.center[None], g.center + B, g.center - B])
            projector = np.outer(g.normal, g.normal)
            variance = g.covariance[2, 2] + (0.7 * half) ** 2 * _largest(g.covariance[:2, :2])
            center = g.center
        case LineGeometry():
            points, center = _padded(np.stack([g.start, g.end])), (g.start + g.end) / 2
            along = (g.end - g.start) / max(float(np.linalg.norm(g.end - g.start)), 1e-9)
            projector = np.eye(3) - np.outer(along, along)
            ends = (g.covariance[:3, :3], g.covariance[3:, 3:])
            variance = max(_largest(projector @ end @ projector) for end in ends)
        case _:
            points, center, projector = _padded(g.position[None]), g.position, np.eye(3)
            variance = _largest(g.covariance)
    reference = np.broadcast_to(center, points.shape)
    return points, reference, projector, center, float(np.sqrt(variance))


def _padded(points: Array) -> Array:
    return points[np.minimum(np.arange(_POINTS), len(points) - 1)]


def _largest(covariance: Array) -> float:
    return float(np.linalg.eigvalsh(covariance)[-1])
