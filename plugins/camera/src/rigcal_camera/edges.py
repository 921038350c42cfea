"""Corners of bare tags as intersections of their border's edges, fitted as lines in space."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry.se3 import Array
from rigcal_camera.corners import sample
from rigcal_camera.frames import Image
from rigcal_camera.lens import Lens

_ALONG = 32
_ACROSS = 25
_ENDS = 0.06
_WINDOW = 0.4
_REACH = 0.6
_MAX_REACH_PX = 3.0
_MAX_MOVE_PX, _MAX_MOVE = 1.5, 0.04
"""How far a corner moves at most: the larger of the two, the second a share of the shortest side (a
lens bends the sides of large tags)."""
_ROUNDS = 3


def refine_by_edges(image: Image, uv: Array, lens: Lens, cell: float) -> Array:
    """Corners (n, 4, 2) of black quadrilaterals on white, from first guesses good to a pixel.

    Along each side the edge is found as the windowed centroid of the grey gradient across it; the
    points are undistorted, so that a straight edge is a line whatever the lens does, and the lines
    of neighbouring sides intersect in the corner. The window stays within one cell, a share
    `cell` of the side: inside the black border, and in the white around it. A corner that would
    move by more than 1.5 px and 4 % of a side, or whose rays are too oblique to be undistorted,
    stays.
    """
    points, weight = _edge_points(image, uv, cell)
    rays = lens.rays_from_pixels(points.reshape(-1, 2))
    with np.errstate(all="ignore"):
        xy = np.where(rays[:, 2:] > 0.1, rays[:, :2] / rays[:, 2:], np.nan)
    lines = _lines(xy.reshape(points.shape), weight)
    corner = np.cross(np.roll(lines, 1, axis=1), lines)
    p_s = corner / corner[..., 2:]
    finite: NDArray[np.bool_] = np.asarray(np.isfinite(p_s).all(axis=-1))
    refined = lens.pixels_from_points(np.where(finite[..., None], p_s, 1.0).reshape(-1, 3))[0]
    refined = refined.reshape(uv.shape)
    side = np.linalg.norm(np.roll(uv, -1, axis=1) - uv, axis=2).min(axis=1, keepdims=True)
    most = np.maximum(_MAX_MOVE_PX, _MAX_MOVE * side)
    near = finite & (np.linalg.norm(refined - uv, axis=-1) < most)
    result: Array = np.where(near[..., None], refined, uv)
    return result


def _edge_points(image: Image, uv: Array, cell: float) -> tuple[Array, Array]:
    """Points (n, 4, k, 2) on the edges from corner i to i + 1, and their weights (n, 4, k)."""
    along = np.roll(uv, -1, axis=1) - uv
    length = np.linalg.norm(along, axis=2)[..., None]
    outward = np.stack([-along[..., 1], along[..., 0]], axis=-1) / length
    share = np.linspace(_ENDS, 1 - _ENDS, _ALONG)
    base = uv[:, :, None] + share[:, None] * along[:, :, None]
    reach = np.minimum(_REACH * cell * length.min(axis=1, keepdims=True), _MAX_REACH_PX)
    offset = np.linspace(-1, 1, _ACROSS) * reach
    probes = base[:, :, :, None] + offset[:, :, None, :, None] * outward[:, :, None, None]
    grey = sample(image, probes)
    slope = np.maximum(np.diff(grey, axis=3), 0.0)
    middle = (offset[..., 1:] + offset[..., :-1])[:, :, None] / 2
    centre = np.zeros((*grey.shape[:3], 1))
    for _ in range(_ROUNDS):
        window = slope * np.exp(-0.5 * ((middle - centre) / (_WINDOW * reach[..., None])) ** 2)
        total = window.sum(axis=3, keepdims=True)
        centre = (window * middle).sum(axis=3, keepdims=True) / np.maximum(total, 1e-9)
    return base + centre * outward[:, :, None], total[..., 0]


def _lines(xy: Array, weight: Array) -> Array:
    """Homogeneous lines (n, 4, 3) through points (n, 4, k, 2): weighted total least squares."""
    weight = np.where(np.isfinite(xy).all(axis=-1), weight, 0.0)
    xy = np.nan_to_num(xy)
    lines = np.zeros((*xy.shape[:2], 3))
    robust = np.ones_like(weight)
    for _ in range(_ROUNDS):
        w = (weight * robust)[..., None]
        total = np.maximum(w.sum(axis=2), 1e-12)
        mean = (w * xy).sum(axis=2) / total
        centred = xy - mean[:, :, None]
        scatter = np.einsum("nskd,nske->nsde", w * centred, centred) / total[..., None]
        normal = np.linalg.eigh(scatter)[1][..., 0]
        lines = np.concatenate([normal, -np.sum(normal * mean, axis=-1, keepdims=True)], axis=-1)
        distance = np.einsum("nskd,nsd->nsk", centred, normal)
        spread = 1.4826 * np.median(np.abs(distance), axis=2, keepdims=True) + 1e-12
        robust = 1 / (1 + (distance / (2.5 * spread)) ** 2)
    return lines
