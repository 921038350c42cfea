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


def voxel_grid(points: Array, voxel: float) -> Array:
    """(M, 3) means of the points (N, 3) in each cell of `voxel` metres, in a fixed order."""
    cloud = _cloud(points).voxel_down_sample(voxel)
    grid = np.asarray(cloud.points)
    return grid[np.lexsort(grid.T)]


def flat_regions(grid: Array, scales: Scales, minimum: int = 6) -> list[NDArray[np.int64]]:
    """Index arrays into `grid` (M, 3): connected flat regions of at least `minimum` points.

    Two points belong together when both have flat, two-dimensional neighbourhoods, they are
    closer than `reach`, their normals agree to 20 degrees, and each lies in the other's plane.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    i, j = cKDTree(grid).query_pairs(scales.radius, output_type="ndarray").T
    n, flat = _normals(grid, i, j, scales)
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
    grid: Array, i: NDArray[np.int64], j: NDArray[np.int64], scales: Scales
) -> tuple[Array, NDArray[np.bool_]]:
    """Normals (M, 3) by principal components, and which neighbourhoods are flat but not thin.

    The neighbours are the pairs (i, j), each given once.
    """
    from scipy.sparse import coo_array

    count = len(grid)
    ones = np.ones(2 * len(i))
    pairs = coo_array((ones, (np.append(i, j), np.append(j, i))), shape=(count, count)).tocsr()
    p = grid - grid.mean(axis=0)
    moments = np.column_stack(
        [np.ones(count), p, p[:, [0, 0, 0, 1, 1, 2]] * p[:, [0, 1, 2, 1, 2, 2]]]
    )
    sums = pairs @ moments + moments
    mean = sums[:, 1:4] / sums[:, :1]
    second = (sums[:, 4:] / sums[:, :1])[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
    values, vectors = np.linalg.eigh(second - mean[:, :, None] * mean[:, None, :])
    spread = np.sqrt(np.maximum(values, 0))
    allowed = scales.flat(np.linalg.norm(grid, axis=1))
    flat = (spread[:, 0] < allowed) & (spread[:, 1] > 0.2 * scales.radius)
    return vectors[..., 0], flat
