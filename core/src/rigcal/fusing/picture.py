"""The fused cloud as a picture, seen from behind and above the rig."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rigcal.fusing.colour import Image, dots
from rigcal.geometry.se3 import Array

if TYPE_CHECKING:
    from rigcal.fusing.fuse import Fused

_SIZE_PX = (1280, 900)
_DOWN_DEG = 35.0
_REACH = 0.7
_CEILING_M = 1.2
"""What hangs higher above the rig than this would hide the rest."""


def oblique(fused: Fused) -> Image:
    """(H, W, 3) RGB: perspective view towards where most coloured points lie."""
    width, height = _SIZE_PX
    picture = np.full((height, width, 3), 255, np.uint8)
    level = _level(fused)
    centre = np.mean(list(fused.places.values()), axis=0)
    p = (fused.points - centre) @ level.T
    kept = p[:, 2] < _CEILING_M
    seen = fused.camera[kept] >= 0
    p, colours = p[kept], fused.colours[kept]
    if not len(p):
        return picture
    aim = p[seen] if seen.any() else p
    heading = np.arctan2(*np.mean(aim[:, :2], axis=0)[::-1])
    reach = float(np.quantile(np.linalg.norm(aim[:, :2], axis=1), _REACH))
    uv, depth = _project(p, heading, reach)
    order = np.argsort(-depth, kind="stable")
    order = order[depth[order] > 0.1 * reach]
    dots(picture, uv[order], colours[order])
    origins = (np.array(list(fused.places.values())) - centre) @ level.T
    dots(picture, _project(origins, heading, reach)[0], np.zeros((len(origins), 3), np.uint8))
    return picture


def _level(fused: Fused) -> Array:
    """(3, 3) to axes with z up; x is any level direction."""
    up = fused.up / np.linalg.norm(fused.up)
    ahead = np.cross(np.eye(3)[np.argmin(np.abs(up))], up)
    ahead /= np.linalg.norm(ahead)
    result: Array = np.stack([ahead, np.cross(up, ahead), up])
    return result


def _project(p: Array, heading: float, reach: float) -> tuple[Array, Array]:
    """Pixels (N, 2) and depths (N,) for an eye behind and above the origin, looking `heading`."""
    width, height = _SIZE_PX
    ahead = np.array([np.cos(heading), np.sin(heading), 0.0])
    left = np.array([-np.sin(heading), np.cos(heading), 0.0])
    down = np.radians(_DOWN_DEG)
    forward = np.cos(down) * ahead - np.sin(down) * np.array([0.0, 0.0, 1.0])
    above = np.cross(forward, -left) * -1.0
    eye = 0.35 * reach * ahead - 1.5 * reach * forward
    d = p - eye
    depth = d @ forward
    scale = 0.62 * width / np.maximum(depth, 1e-6)
    u = width / 2 - scale * (d @ left)
    v = height / 2 - scale * (d @ above)
    return np.stack([u, v], axis=1), depth
