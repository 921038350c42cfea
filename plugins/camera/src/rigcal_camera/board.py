"""The printed face of the board as a camera's pixels see it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import inside_convex
from rigcal.targets.target import Target
from rigcal_camera.texture import Texture, texture_of

FloatImage = NDArray[np.float32]
Slopes = tuple[FloatImage, FloatImage]
"""By how much points of the face (..., 2) change from pixel to pixel, along u and along v."""

_FAR_M = 1e3
_FINE = ((21, 13), (34, 21), (55, 34))
"""Points in a pixel, and the step between their rows: numbers of Fibonacci make even lattices."""
_BLOCK = 4096
_UPPER_LEFT = np.array([-0.5, -0.5], dtype=np.float32)


def face_of(
    target: Target, T_s_t: Array, rays: FloatImage, px_per_mm: float, points: int = 2_000_000
) -> FloatImage:
    """Grey (H, W) in 0..1 of the board's face along rays (H, W, 3), as if it had no end.

    A pixel in which the print has an edge is the mean of the print at 21 to 55 points in it. No
    two of them lie in the same row or column of the pixel, and each has the mean over its share:
    an edge lies where it is printed at any distance and in any direction. White from behind.
    `points` is how many there may be in all such pixels together.
    """
    T_t_s = se3.inverse(T_s_t)
    if T_t_s[2, 3] <= 0:
        return np.ones(rays.shape[:2], dtype=np.float32)
    xy = points_on_face(rays, T_t_s)
    by_uv = np.gradient(xy, axis=1), np.gradient(xy, axis=0)
    pixel_m, texture = _pixel_on_face(xy, by_uv, target), texture_of(target, px_per_mm)
    coarse = texture.reduced(pixel_m / 2)
    face = coarse.sample(xy)
    edge = _differs(face, coarse.sample(_shifted(xy, by_uv, _UPPER_LEFT)))
    _draw_edges(face, edge, xy, by_uv, texture, pixel_m, points)
    return face / np.float32(255)


def _differs(middle: FloatImage, corner: FloatImage) -> NDArray[np.bool_]:
    """Which pixels have other greys in a corner than in another or in their middle, given those
    (H, W) of the middles and of the upper left corners.
    """
    framed = np.pad(corner, ((0, 1), (0, 1)), mode="edge")
    corners = framed[:-1, :-1], framed[:-1, 1:], framed[1:, :-1], framed[1:, 1:]
    low, high = middle, middle
    for other in corners:
        low, high = np.minimum(low, other), np.maximum(high, other)
    return high - low > 1


def _draw_edges(
    face: FloatImage,
    edge: NDArray[np.bool_],
    xy: FloatImage,
    by_uv: Slopes,
    texture: Texture,
    pixel_m: Array,
    points: int,
) -> None:
    """The mean of 21 points or more in each pixel of `edge`, as many as `points` allow."""
    v, u = np.nonzero(edge)
    allowed = max(points // max(len(v), 1), _FINE[0][0])
    lattice = max(lattice for lattice in _FINE if lattice[0] <= allowed)
    fine = texture.reduced(pixel_m / np.sqrt(lattice[0]))
    places = _lattice(*lattice)
    for start in range(0, len(v), _BLOCK):
        at = v[start : start + _BLOCK, None], u[start : start + _BLOCK, None]
        slopes = by_uv[0][at], by_uv[1][at]
        face[at[0][:, 0], at[1][:, 0]] = fine.sample(_shifted(xy[at], slopes, places)).mean(axis=1)


def _shifted(xy: FloatImage, by_uv: Slopes, place: FloatImage) -> FloatImage:
    """Points of the face at places (..., 2) in the pixels, given their middles and slopes."""
    result: FloatImage = xy + place[..., :1] * by_uv[0] + place[..., 1:] * by_uv[1]
    return result


def _lattice(count: int, step: int) -> NDArray[np.float32]:
    """Places (count, 2) in a pixel, -0.5 to 0.5: a lattice of which no direction is coarse."""
    index = np.arange(count)
    places = (np.stack([index, index * step % count], axis=1) + 0.5) / count - 0.5
    return places.astype(np.float32)


def points_on_face(rays: FloatImage, T_t_s: Array) -> FloatImage:
    """Where rays (H, W, 3) meet the board's plane, (H, W, 2) in its frame; far off if nowhere."""
    origin = T_t_s[:3, 3].astype(np.float32)
    d_t = rays @ T_t_s[:3, :3].T.astype(np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = -origin[2] / d_t[..., 2]
        xy = origin[:2] + t[..., None] * d_t[..., :2]
    xy[~(t > 0)] = _FAR_M
    near: FloatImage = np.clip(xy, -_FAR_M, _FAR_M, out=xy)
    return near


def _pixel_on_face(xy: FloatImage, by_uv: Slopes, target: Target) -> Array:
    """Extent (2,) of a pixel along the board's x and y (m), the median over the board."""
    on_board = inside_convex(xy.astype(np.float64), target.outline)
    if not on_board.any():
        return np.zeros(2)
    result: Array = np.median(np.hypot(by_uv[0][on_board], by_uv[1][on_board]), axis=0)
    return result
