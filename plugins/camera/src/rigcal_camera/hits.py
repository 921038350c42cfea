"""Which thing of the scene every pixel shows, with few rays: edges are found and followed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.scene import Scene
from rigcal_camera.lens import Lens

NOTHING, DARK = -1, -2
"""What pixels show that look past everything, and pixels that the lens does not reach."""

_UNKNOWN = -3
_STEP = 16

Hits = NDArray[np.int16]
Look = Callable[[NDArray[np.intp], NDArray[np.intp]], NDArray[np.int64]]


def hit_map(lens: Lens, rays: NDArray[np.float32], T_w_s: Array, scene: Scene) -> Hits:
    """What the middle of every pixel shows (H, W): the numbers of `Scene.cast`, or `DARK`.

    rays: unit directions (H, W, 3) of the camera's frame, NaN where the lens does not reach.
    Rays are followed at every 16th pixel, and between those that differ at every 8th, 4th, second
    and single one. What lies across the border of such a cell is followed into the next cell, and
    the cells around the middle of each thing are looked into: things of 2 px are found.
    """
    height, width = rays.shape[:2]

    def look(v: NDArray[np.intp], u: NDArray[np.intp]) -> NDArray[np.int64]:
        d_s = rays[np.minimum(v, height - 1), np.minimum(u, width - 1)].astype(np.float64)
        hit = np.full(len(d_s), DARK, dtype=np.int64)
        lit = np.isfinite(d_s[:, 0])
        hit[lit] = scene.cast(T_w_s[:3, 3], d_s[lit] @ T_w_s[:3, :3].T)[1]
        return hit

    padded = [-(-(size - 1) // _STEP) * _STEP + 1 for size in (height, width)]
    hits = np.full(padded, _UNKNOWN, dtype=np.int16)
    coarse = hits[::_STEP, ::_STEP]
    v, u = np.indices(coarse.shape) * _STEP
    coarse[...] = look(v.ravel(), u.ravel()).reshape(coarse.shape)
    seeds = _middles(lens, T_w_s, scene)
    step = _STEP
    while step > 1:
        _refine(hits[:: step // 2, :: step // 2], seeds // step, step // 2, look)
        step //= 2
    return hits[:height, :width]


def edges_of(hits: Hits) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns (N,) of pixels that show something else than a neighbour above, below, left
    or right.
    """
    edge = np.zeros(hits.shape, dtype=bool)
    across, down = hits[:, 1:] != hits[:, :-1], hits[1:] != hits[:-1]
    edge[:, 1:] |= across
    edge[:, :-1] |= across
    edge[1:] |= down
    edge[:-1] |= down
    v, u = np.nonzero(edge)
    return v, u


def around(hits: Hits, v: NDArray[np.intp], u: NDArray[np.intp]) -> Hits:
    """What the 3 x 3 pixels around pixels show (N, 9)."""
    framed = np.pad(hits, 1, mode="edge")
    return np.stack([framed[v + i, u + j] for i in range(3) for j in range(3)], axis=1)


def _middles(lens: Lens, T_w_s: Array, scene: Scene) -> NDArray[np.intp]:
    """Pixels (N, 2), column and row, in which the middle of a thing lies."""
    middles = [shape.bounds[0] for shape in scene.shapes]
    if scene.T_w_t is not None:
        middles.append(scene.T_w_t[:3, 3])
    p_s = se3.apply(se3.inverse(T_w_s), np.array(middles).reshape(-1, 3))
    uv = lens.pixels_from_points(p_s)[0][lens.sees(p_s)]
    return np.maximum(np.round(uv), 0).astype(np.intp)


def _refine(grid: Hits, seeds: NDArray[np.intp], spacing: int, look: Look) -> None:
    """Fill a grid (2 R + 1, 2 C + 1) of which every second row and column is known.

    A cell is 3 x 3 of its points; points of neighbouring cells are shared. `seeds` (N, 2), column
    and row, are cells to look into anyway.
    """
    corners = grid[::2, ::2].copy()
    mixed = corners[1:, 1:] != corners[:-1, :-1]
    mixed |= corners[1:, :-1] != corners[:-1, :-1]
    mixed |= corners[:-1, 1:] != corners[:-1, :-1]
    column, row = np.minimum(seeds, np.array(mixed.shape[::-1]) - 1).T
    mixed[row, column] = True
    cells = np.argwhere(mixed)
    while len(cells):
        v, u = np.unravel_index(np.unique(_points_of(cells, grid)), grid.shape)
        unknown = grid[v, u] == _UNKNOWN
        v, u = v[unknown], u[unknown]
        grid[v, u] = look(v * spacing, u * spacing)
        cells = _neighbours(cells, mixed)
        points = grid[np.unravel_index(_points_of(cells, grid), grid.shape)]
        crossed = ((points != points[:, :1]) & (points != _UNKNOWN)).any(axis=1)
        cells = cells[crossed]
        mixed[cells[:, 0], cells[:, 1]] = True
    filled = np.repeat(np.repeat(corners, 2, axis=0), 2, axis=1)[:-1, :-1]
    np.copyto(grid, filled, where=grid == _UNKNOWN)


def _points_of(cells: NDArray[np.intp], grid: Hits) -> NDArray[np.intp]:
    """Flat indices (N, 9) of the points of cells (N, 2), row and column; the first a corner."""
    step = np.arange(3)
    first = 2 * cells[:, 0] * grid.shape[1] + 2 * cells[:, 1]
    result: NDArray[np.intp] = first[:, None] + (step[:, None] * grid.shape[1] + step).ravel()
    return result


def _neighbours(cells: NDArray[np.intp], taken: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Cells (M, 2) that share a side with given ones (N, 2) and are not taken."""
    sides = np.array([[-1, 0], [1, 0], [0, -1], [0, 1]])
    beside = (cells[:, None] + sides).reshape(-1, 2)
    beside = beside[((beside >= 0) & (beside < taken.shape)).all(axis=1)]
    flat = np.unique(beside[:, 0] * taken.shape[1] + beside[:, 1])
    free = flat[~taken.ravel()[flat]]
    return np.stack(np.unravel_index(free, taken.shape), axis=1)
