"""Flat regions of an unordered cloud, by growing over points whose neighbourhoods are flat.

Works on a voxel grid, so that rings, spinning scans and depth images look alike. Nothing here
is random: the same cloud gives the same regions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigcal.geometry.se3 import Array
from rigcal.ranging import RangeNoise
from rigcal_lrf3d.open3d_import import open3d

_ALIKE = float(np.cos(np.radians(20)))
_GRAZING = float(np.sin(np.radians(8)))
"""Mixed pixels hang like curtains along the beams from a board's edge to what is behind it."""


@dataclass(frozen=True)
class Scales:
    """Lengths (m) of the segmentation, from the board's short side and the noise of ranges.

    `voxel` is the grid; `radius` the neighbourhood that gives a normal; `reach` the largest gap
    between beams that is bridged (a board with four scan lines across is connected); `edge` how
    much of the outline's rim is not trusted to show the plane.
    """

    short: float
    noise: RangeNoise

    @staticmethod
    def of(size: Array, noise: RangeNoise) -> Scales:
        """The scales for a board of `size` (2,) metres."""
        return Scales(float(np.min(size)), noise)

    @property
    def voxel(self) -> float:
        """See the class."""
        return self.short / 10

    @property
    def radius(self) -> float:
        """See the class."""
        return 0.35 * self.short

    @property
    def reach(self) -> float:
        """See the class."""
        return 0.27 * self.short

    @property
    def edge(self) -> float:
        """See the class."""
        return 0.02 * self.short

    def thickness(self, ranges: ArrayLike) -> Array:
        """How far points of the board at these ranges may lie from its plane.

        Boards bend, and sigmas are guessed too small: it has a floor, as `flat` has.
        """
        return np.maximum(3.5 * self.noise.of(ranges), 0.04 * self.short)

    def flat(self, ranges: ArrayLike) -> Array:
        """The largest rms of flat neighbourhoods at these ranges."""
        return np.maximum(2.0 * self.noise.of(ranges), 0.03 * self.short)


def voxel_grid(points: Array, voxel: float) -> tuple[Array, NDArray[np.int64]]:
    """Means (M, 3) and numbers (M,) of the points (N, 3) in each cell of `voxel` metres.

    In a fixed order.
    """
    cells = np.floor((points - points.min(axis=0)) / voxel + 0.5).astype(np.int64)
    order = np.lexsort(cells.T)
    starts = np.flatnonzero(np.any(np.diff(cells[order], axis=0, prepend=-1), axis=1))
    count = np.diff(starts, append=len(points))
    sums = np.add.reduceat(points[order], starts)
    return sums / count[:, None], count


def flat_regions(
    grid: Array, count: NDArray[np.int64], scales: Scales, minimum: int = 6
) -> list[NDArray[np.int64]]:
    """Connected flat regions of at least `minimum` points, as index arrays into `grid`.

    `grid` (M, 3) are the cells of a cloud, `count` (M,) the points in each. Two cells belong
    together when both have flat, two-dimensional neighbourhoods that the beams from the origin do
    not graze, they are closer than `reach`, their normals agree to 20 degrees, and each lies in the
    other's plane.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    i, j = cKDTree(grid).query_pairs(scales.radius, output_type="ndarray").T
    n, flat = _normals(grid, count, i, j, scales)
    flat &= np.abs(np.sum(n * grid, axis=1)) > _GRAZING * np.linalg.norm(grid, axis=1)
    delta = grid[j] - grid[i]
    alike = flat[i] & flat[j] & (np.einsum("ij,ij->i", delta, delta) < scales.reach**2)
    i, j, delta = i[alike], j[alike], delta[alike]
    alike = np.abs(np.einsum("ij,ij->i", n[i], n[j])) > _ALIKE
    thickness = scales.thickness(np.linalg.norm(grid, axis=1))
    for k in (i, j):
        alike &= np.abs(np.einsum("ij,ij->i", n[k], delta)) < thickness[k]
    i, j = i[alike], j[alike]
    graph = coo_array((np.ones(len(i), dtype=np.int8), (i, j)), shape=(len(grid), len(grid)))
    label = connected_components(graph, directed=False)[1]
    order = np.argsort(label, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
    return sorted((p for p in parts if len(p) >= minimum), key=lambda p: (-len(p), p[0]))


def connected(points: Array, seeds: NDArray[np.bool_], reach: float) -> NDArray[np.bool_]:
    """Which of (N, 3) points hang together (steps < `reach`) with most of the seeds (N,)."""
    label = np.asarray(_cloud(points).cluster_dbscan(eps=reach, min_points=2))
    counts = np.bincount(label[seeds & (label >= 0)], minlength=1)
    result: NDArray[np.bool_] = label == np.argmax(counts)
    return result


def _cloud(points: Array) -> Any:
    o3d = open3d()
    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.ascontiguousarray(points)))


def _normals(
    grid: Array,
    weights: NDArray[np.int64],
    i: NDArray[np.int64],
    j: NDArray[np.int64],
    scales: Scales,
) -> tuple[Array, NDArray[np.bool_]]:
    """Normals (M, 3) by principal components, and which neighbourhoods are flat but not thin.

    The neighbours are the pairs (i, j), each given once. By their weights (M,) a few stray
    returns near a dense board do not spoil its flatness.
    """
    from scipy.sparse import coo_array

    count = len(grid)
    ones = np.ones(2 * len(i))
    pairs = coo_array((ones, (np.append(i, j), np.append(j, i))), shape=(count, count)).tocsr()
    p = grid - grid.mean(axis=0)
    moments = np.column_stack(
        [np.ones(count), p, p[:, [0, 0, 0, 1, 1, 2]] * p[:, [0, 1, 2, 1, 2, 2]]]
    )
    moments *= weights[:, None]
    sums = pairs @ moments + moments
    mean = sums[:, 1:4] / sums[:, :1]
    second = (sums[:, 4:] / sums[:, :1])[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
    values, vectors = np.linalg.eigh(second - mean[:, :, None] * mean[:, None, :])
    spread = np.sqrt(np.maximum(values, 0))
    allowed = scales.flat(np.linalg.norm(grid, axis=1))
    flat = (spread[:, 0] < allowed) & (spread[:, 1] > 0.2 * scales.radius)
    return vectors[..., 0], flat
