"""A cloud as a picture: parallel projection from behind and above the sensor, towards the board."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigcal.fusing.colour import dots
from rigcal.geometry.se3 import Array

if TYPE_CHECKING:
    from matplotlib.colors import Colormap, Normalize

_WIDTH_PX, _HEIGHT_PX = 480, 400
_DOWN_DEG, _SIDE_DEG = 25.0, 35.0
_MARGIN_M = 0.5
_AROUND_M = 1.2


@dataclass(frozen=True, eq=False)
class Picture:
    """RGBA pixels over `extent` (left, right, bottom, top; m), the board's outline (K, 2) and the
    sensor's place (2,) in it, and what the colours mean.
    """

    pixels: NDArray[np.uint8]
    extent: tuple[float, float, float, float]
    outline: Array
    origin: Array
    norm: Normalize
    colours: Colormap


def oblique_view(points: Array, outline: Array, R_l_s: Array) -> Picture:
    """The points (N, 3) around the sensor and a board (K, 3), all in the sensor's frame.

    `R_l_s` (3, 3) takes the sensor's axes to level ones, z up. Points more than 1.2 m beyond both
    are left out: walls would hide the board. Colour is the range.
    """
    from matplotlib import colormaps
    from matplotlib.colors import Normalize

    R_v_l = _looking_at((outline @ R_l_s.T).mean(axis=0))
    board, sensor = outline @ R_l_s.T, np.zeros((1, 3))
    subject = np.concatenate([board, sensor])
    p_l = points @ R_l_s.T
    low, high = subject.min(axis=0) - _AROUND_M, subject.max(axis=0) + _AROUND_M
    kept = ((p_l >= low) & (p_l <= high)).all(axis=1)
    p_v, ranges = p_l[kept] @ R_v_l.T, np.linalg.norm(points[kept], axis=1)
    extent = _extent(subject @ R_v_l.T)
    farthest = float(np.linalg.norm(board, axis=1).max()) + _AROUND_M
    norm = Normalize(ranges.min(initial=farthest), farthest)
    colours = colormaps["turbo"]
    pixels = np.zeros((_HEIGHT_PX, _WIDTH_PX, 4), np.uint8)
    # The farthest first: nearer points cover them.
    order = np.argsort(-p_v[:, 2])
    column = (p_v[order, 0] - extent[0]) / (extent[1] - extent[0]) * _WIDTH_PX
    row = (extent[3] - p_v[order, 1]) / (extent[3] - extent[2]) * _HEIGHT_PX
    uv = np.column_stack([column, row]) - 0.5
    dots(pixels, uv, colours(norm(ranges[order]), bytes=True))
    return Picture(
        pixels, extent, (board @ R_v_l.T)[:, :2], (sensor @ R_v_l.T)[0, :2], norm, colours
    )


def _looking_at(p_l: Array) -> Array:
    """`R_v_l` (3, 3) to x right, y up, z away from the eye, for a look towards `p_l` (3,)."""
    heading = np.arctan2(p_l[1], p_l[0]) + np.radians(_SIDE_DEG)
    down = np.radians(_DOWN_DEG)
    ahead = np.array([np.cos(heading), np.sin(heading), 0.0])
    away = np.cos(down) * ahead - np.sin(down) * np.array([0.0, 0.0, 1.0])
    right = np.array([np.sin(heading), -np.cos(heading), 0.0])
    result: Array = np.stack([right, np.cross(right, away), away])
    return result


def _extent(subject: Array) -> tuple[float, float, float, float]:
    """A box of the picture's shape around points (N, 3)."""
    low, high = subject[:, :2].min(axis=0) - _MARGIN_M, subject[:, :2].max(axis=0) + _MARGIN_M
    shape = _WIDTH_PX / _HEIGHT_PX
    width = max(high[0] - low[0], (high[1] - low[1]) * shape)
    middle, half = (low + high) / 2, np.array([width, width / shape]) / 2
    (left, bottom), (right, top) = middle - half, middle + half
    return float(left), float(right), float(bottom), float(top)
