"""Corners where the print, drawn as the camera would see it, fits the image best."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import inside_convex
from rigcal.targets.target import Target
from rigcal_camera.board import FloatImage, face_of, points_on_face
from rigcal_camera.frames import Image
from rigcal_camera.lens import Lens

_HALF, _MARGIN = 7, 4
"""Half of the window in which the two are compared, and pixels around it for blur and slopes."""
_BLUR_PX = 0.7
_EDGE_PX = 2
_WEIGHT_SIGMA_PX = 4.0
_PX_PER_MM = 1.0
_POINTS = 1_000_000
_ROUNDS = 3
_SETTLED_PX = 0.03
_MOST_MOVED_PX = 1.0
_LEAST_SHARE = 0.25
_LEAST_EXPLAINED = 0.8


def align_corners(
    image: Image, uv: Array, p_t: Array, target: Target, lens: Lens, T_s_t: Array
) -> Array:
    """Corners (N, 2), from first ones that belong to target points `p_t` (N, 3) seen from about
    `T_s_t`.

    Around each corner the image is compared with the target's print, drawn as the pose shows it but
    with this corner where it was found: neither pose nor lens pull at it. The least squares of
    `image - gain * print - offset` over shift, gain, offset and blur (which changes an image by its
    Laplacian) say how far the print lies beside the image (Lucas & Kanade 1981). All that is
    printed near by takes part, so that nothing there biases it. A corner stays as it was where the
    board ends or is hidden, where the image does not look like the print, or if it would move by
    more than 1 px.
    """
    result = np.array(uv)
    reach = _HALF + _MARGIN
    middle = np.round(uv).astype(np.intp)
    inside = (middle >= reach) & (middle < np.array([lens.width, lens.height]) - reach)
    left = np.flatnonzero(inside.all(axis=1))
    if not target.patches:
        return result
    step = np.arange(-reach, reach + 1)
    window = np.stack(np.meshgrid(step, step), axis=-1)
    predicted = lens.pixels_from_points(se3.apply(T_s_t, p_t))[0]
    for _ in range(_ROUNDS):
        if not len(left):
            break
        pixels = middle[left, None, None] + window
        there = pixels + (predicted - result)[left, None, None]
        rays = lens.rays_from_pixels(there.reshape(-1, 2)).astype(np.float32)
        drawn = _drawn(rays.reshape(-1, len(step), 3), target, T_s_t)
        grey = image[pixels[..., 1], pixels[..., 0]].astype(np.float64)
        shift, alike = _shifts(grey, (result - middle)[left], *drawn)
        moved = result[left] + shift
        good = alike & (np.linalg.norm(moved - uv[left], axis=1) < _MOST_MOVED_PX)
        result[left] = np.where(good[:, None], moved, uv[left])
        left = left[good & (np.abs(shift).max(axis=1) > _SETTLED_PX)]
    return result


def _shifts(
    grey: Array, place: Array, fields: tuple[Array, ...], on_board: NDArray[np.uint8]
) -> tuple[Array, NDArray[np.bool_]]:
    """How far windows (n, side, side) of the image lie beside the print (n, 2), and whether the two
    are alike (n,).

    place: the corners (n, 2) from the middles of the windows; fields, on_board: what `_drawn` says
    of the windows, one below the other.
    """
    inner = np.s_[:, _MARGIN:-_MARGIN, _MARGIN:-_MARGIN]
    parts = [f.reshape(grey.shape)[inner].reshape(len(grey), -1) for f in fields]
    A = np.stack([*parts, np.ones_like(parts[0])], axis=-1)
    b = grey[inner].reshape(len(grey), -1)
    step = np.arange(-_HALF, _HALF + 1)
    squared = (step - place[:, :1])[:, None, :] ** 2 + (step - place[:, 1:])[:, :, None] ** 2
    near = np.exp(-0.5 * squared / _WEIGHT_SIGMA_PX**2).reshape(len(grey), -1)
    weight = near * on_board.reshape(grey.shape)[inner].reshape(len(grey), -1)
    AtA = np.einsum("nki,nk,nkj->nij", A, weight, A)
    scale = np.sqrt(np.einsum("nii->ni", AtA)) + 1e-6
    AtA = AtA / (scale[:, :, None] * scale[:, None, :]) + 1e-9 * np.eye(A.shape[2])
    Atb = np.einsum("nki,nk,nk->ni", A, weight, b) / scale
    x = np.linalg.solve(AtA, Atb[..., None])[..., 0] / scale
    total = weight.sum(axis=1)
    mean = (weight * b).sum(axis=1) / np.maximum(total, 1e-9)
    left = (weight * (b - np.einsum("nki,ni->nk", A, x)) ** 2).sum(axis=1)
    all_ = (weight * (b - mean[:, None]) ** 2).sum(axis=1)
    good = left < (1 - _LEAST_EXPLAINED) * all_
    good &= total > _LEAST_SHARE * near.sum(axis=1)
    good &= x[:, 0] != 0
    # A gain below zero: the print has black and white the other way round.
    return -x[:, 1:3] / np.where(good[:, None], x[:, :1], 1.0), good


def _drawn(
    rays: FloatImage, target: Target, T_s_t: Array
) -> tuple[tuple[Array, ...], NDArray[np.uint8]]:
    """The blurred print, its slopes along u and v and its Laplacian, and where the board is."""
    import cv2

    sharp = 255 * face_of(target, T_s_t, rays, _PX_PER_MM, points=_POINTS)
    face = np.asarray(cv2.GaussianBlur(sharp, (0, 0), _BLUR_PX), np.float64)
    down, across = (np.asarray(np.gradient(face, axis=i), np.float64) for i in (0, 1))
    xy = points_on_face(rays, se3.inverse(T_s_t)).astype(np.float64)
    on_board = inside_convex(xy, target.outline).astype(np.uint8)
    side = 2 * _EDGE_PX + 1
    away = cv2.erode(on_board, np.ones((side, side), np.uint8))
    laplacian = np.asarray(cv2.Laplacian(face, cv2.CV_64F), np.float64)
    return (face, across, down, laplacian), np.asarray(away, np.uint8)
