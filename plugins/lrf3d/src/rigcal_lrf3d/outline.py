"""The known board's rectangle, placed on the points of a plane, and how well it explains them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import inside_convex

_STEP_DEG = 3.0


@dataclass(frozen=True, eq=False)
class Placement:
    """A rectangle of the board's size on (N, 2) points of a plane.

    `polygon` (4, 2) anticlockwise. `coverage` in [0, 1] is the share of the rectangle that the
    hull of the points in it covers; `containment` the share of the points that lie in it.
    """

    polygon: Array
    coverage: float
    containment: float


def place_rectangle(uv: Array, size: Array, cell: float) -> Placement:
    """The rectangle of `size` (2,) that holds most of the points `uv` (N, 2), evenly spread.

    All angles in steps of 3 degrees and all shifts in steps of `cell` (m) are tried, by sums over
    windows of a histogram; among the best, the one whose points fill the smallest box is centred
    on them. Points that do not belong to the board (a hand, an arm in its plane) are left outside.
    """
    angles = np.radians(np.arange(0.0, 180.0, _STEP_DEG))
    axes = np.stack([np.cos(angles), np.sin(angles), -np.sin(angles), np.cos(angles)], axis=-1)
    axes = axes.reshape(-1, 2, 2)
    rotated = np.einsum("tij,nj->tni", axes, uv)
    low = rotated.min(axis=1, keepdims=True)
    window = np.ceil(size / cell).astype(int) + 1
    bins = ((rotated - low) / cell).astype(int)
    shape = np.maximum(bins.max(axis=(0, 1)) + 1, window)
    counts, corner = _best_windows(bins, shape, window)
    held = np.all((bins >= corner[:, None]) & (bins < (corner + window)[:, None]), axis=-1)
    top = np.where(held[..., None], rotated, -np.inf).max(axis=1)
    bottom = np.where(held[..., None], rotated, np.inf).min(axis=1)
    excess = np.maximum(top - bottom - size, 0).sum(axis=1) / cell
    best = int(np.argmax(counts / len(uv) - 0.02 * excess - 1e-6 * np.prod(top - bottom, axis=1)))
    center = (top[best] + bottom[best]) / 2
    corners = center + size / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    polygon = corners @ axes[best]
    inside = inside_convex(uv, polygon, margin=cell / 2)
    coverage = min(hull_area(uv[inside]) / float(np.prod(size)), 1.0)
    return Placement(polygon, coverage, float(inside.mean()))


def _best_windows(
    bins: NDArray[np.int64], shape: NDArray[np.int64], window: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Per angle (T,) the largest count in a window, and the window's lower corner (T, 2).

    bins (T, N, 2) are the points' cells in a grid of `shape`.
    """
    turns = len(bins)
    flat = (np.arange(turns)[:, None] * shape[0] + bins[..., 0]) * shape[1] + bins[..., 1]
    grid = np.bincount(flat.ravel(), minlength=turns * int(np.prod(shape)))
    sums = np.zeros((turns, shape[0] + 1, shape[1] + 1), dtype=np.int64)
    sums[:, 1:, 1:] = grid.reshape(turns, *shape).cumsum(axis=1).cumsum(axis=2)
    w, h = window
    held = sums[:, w:, h:] - sums[:, :-w, h:] - sums[:, w:, :-h] + sums[:, :-w, :-h]
    best = held.reshape(turns, -1).argmax(axis=1)
    corner = np.stack(np.unravel_index(best, held.shape[1:]), axis=-1)
    return held.reshape(turns, -1).max(axis=1), corner


def hull(uv: Array) -> Array:
    """(K, 2) anticlockwise convex hull of (N, 2) points; K = 0 where they lie on a line."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return uv[ConvexHull(uv).vertices]
    except (QhullError, ValueError):
        return np.zeros((0, 2))


def hull_area(uv: Array) -> float:
    """Area of the convex hull of (N, 2) points."""
    corners = hull(uv)
    if len(corners) < 3:
        return 0.0
    x, y = corners.T
    return float(abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2)
