"""The printed face of the board as a camera's pixels see it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import inside_convex
from rigcal.targets.target import Target
from rigcal_camera.texture import texture_of

FloatImage = NDArray[np.float32]

_SAMPLES = 3
_FAR_M = 1e3


def face_of(target: Target, T_s_t: Array, rays: FloatImage, px_per_mm: float) -> FloatImage:
    """Grey (H, W) in 0..1 of the board's face along rays (H, W, 3), as if it had no end.

    Each pixel is the mean of 3 x 3 points on the face. The texture is reduced by area to texels as
    wide as the points are apart and interpolated between them, so that the points together weigh
    all of the pixel evenly: an edge lies where it is printed at any distance, also one along the
    pixels' rows. White from behind.
    """
    import cv2

    height, width = rays.shape[:2]
    T_t_s = se3.inverse(T_s_t)
    if T_t_s[2, 3] <= 0:
        return np.ones((height, width), dtype=np.float32)
    xy = _plane_points(rays, T_t_s)
    fine = (width * _SAMPLES, height * _SAMPLES)
    fine_xy = np.asarray(cv2.resize(xy, fine, interpolation=cv2.INTER_LINEAR), np.float32)
    texel_m = _pixel_on_face(xy, target) / _SAMPLES
    face = texture_of(target, px_per_mm).sample(fine_xy, texel_m)
    mean = cv2.resize(face, (width, height), interpolation=cv2.INTER_AREA)
    result: FloatImage = np.asarray(mean, np.float32) / np.float32(255)
    return result


def _plane_points(rays: FloatImage, T_t_s: Array) -> FloatImage:
    """Where rays (H, W, 3) meet the board's plane, (H, W, 2) in its frame; far off if nowhere."""
    origin = T_t_s[:3, 3].astype(np.float32)
    d_t = rays @ T_t_s[:3, :3].T.astype(np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = -origin[2] / d_t[..., 2]
        xy = origin[:2] + t[..., None] * d_t[..., :2]
    xy[~(t > 0)] = _FAR_M
    near: FloatImage = np.clip(xy, -_FAR_M, _FAR_M, out=xy)
    return near


def _pixel_on_face(xy: FloatImage, target: Target) -> Array:
    """Extent (2,) along the board's x and y (m) of a pixel's sides, the median over the board."""
    sides = np.stack([np.diff(xy, axis=1)[:-1], np.diff(xy, axis=0)[:, :-1]])
    on_board = inside_convex(xy[:-1, :-1].astype(np.float64), target.outline)
    if not on_board.any():
        return np.zeros(2)
    result: Array = np.median(np.abs(sides[:, on_board]), axis=1).max(axis=0)
    return result
