"""Colours of points from images, and which points an image can show at all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry.se3 import Array

Image = NDArray[np.uint8]
_SLACK_M, _SLACK = 0.1, 0.03
"""A point this much (m, and share of its range) behind the nearest one is hidden by it."""
_CELL = 1.5
_CELLS_PX = (2.0, 40.0)


def visible(uv: Array, ranges: Array, inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which points (N,) at pixels uv (N, 2) are in the image and not hidden by nearer ones.

    By depth buffers whose cells are 1.5 times as wide as the points lie apart in the image: denser
    ones would let the background shine through between the points of a foreground. There are two,
    half a cell apart, so that a foreground which ends at the border of a cell hides as well.
    """
    result = inside.copy()
    index = np.flatnonzero(inside)
    if not len(index):
        return result
    size = np.ptp(uv[index], axis=0) + 1
    cell = float(np.clip(_CELL * np.sqrt(size.prod() / len(index)), *_CELLS_PX))
    for shift in (0.0, 0.5):
        at = np.floor((uv[index] - uv[index].min(axis=0)) / cell + shift).astype(np.intp)
        nearest = np.full(tuple(at.max(axis=0) + 1), np.inf)
        np.minimum.at(nearest, tuple(at.T), ranges[index])
        result[index] &= ranges[index] <= nearest[tuple(at.T)] * (1 + _SLACK) + _SLACK_M
    return result


def sample(image: Image, uv: Array) -> Image:
    """(N, 3) RGB of the pixels nearest to uv (N, 2)."""
    height, width = image.shape[:2]
    u = np.clip(np.round(uv[:, 0]).astype(np.intp), 0, width - 1)
    v = np.clip(np.round(uv[:, 1]).astype(np.intp), 0, height - 1)
    found = image[v, u]
    return np.repeat(found[:, None], 3, axis=1) if found.ndim == 1 else found


def by_range(ranges: Array) -> Image:
    """(N, 3) RGB: blue is near, red far."""
    from matplotlib import colormaps

    if not len(ranges):
        return np.zeros((0, 3), np.uint8)
    low, high = np.quantile(ranges, [0.02, 0.98])
    shares = (ranges - low) / max(high - low, 1e-6)
    result: Image = np.round(colormaps["turbo"](shares)[:, :3] * 255).astype(np.uint8)
    return result


def dots_by_range(picture: Image, uv: Array, ranges: Array) -> None:
    """Paint points at pixels uv (N, 2), coloured by range (N,); nearer ones cover farther ones."""
    order = np.argsort(-ranges, kind="stable")
    dots(picture, uv[order], by_range(ranges)[order])


def dots(picture: Image, uv: Array, colours: Image) -> None:
    """Paint squares of 3 pixels (H, W, C) in colours (N, C), those that come later over others."""
    height, width = picture.shape[:2]
    square = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), axis=-1).reshape(-1, 2)
    at = (np.round(uv).astype(np.intp)[:, None] + square).reshape(-1, 2)
    inside = np.all((at >= 0) & (at < (width, height)), axis=1)
    u, v = at[inside].T
    picture[v, u] = np.repeat(colours, len(square), axis=0)[inside]
