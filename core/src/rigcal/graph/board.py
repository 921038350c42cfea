"""The board as one observation places it: its plane, its middle, points that stand for it."""

from __future__ import annotations

import numpy as np

from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import plane_of_target, tangent_basis
from rigcal.observation import Geometry, LineGeometry, PlaneGeometry, PoseGeometry
from rigcal.targets.target import Target


def half_size(target: Target) -> float:
    """The lever (m) with which a tilt acts on the board: rms over its face, about its centre."""
    return 0.35 * float(np.hypot(*target.size) / np.sqrt(2))


def plane_of(g: Geometry) -> tuple[Array, float]:
    """Normal towards the sensor's side and distance of the target's plane, from pose or plane."""
    if isinstance(g, PoseGeometry):
        n, d = plane_of_target(g.T_s_t)
        return n, float(d)
    assert isinstance(g, PlaneGeometry)
    return g.normal, g.d


def center_of(g: Geometry) -> Array:
    """(3,) where on the target the sensor looked."""
    match g:
        case PoseGeometry():
            center: Array = g.T_s_t[:3, 3]
            return center
        case PlaneGeometry():
            return g.center
        case LineGeometry():
            return (g.start + g.end) / 2
    return g.position


def board_points(g: PlaneGeometry | LineGeometry, half: float) -> Array:
    """(m, 3) points that stand for the observation: a plane's tilt acts on the board's extent."""
    if isinstance(g, LineGeometry):
        return np.stack([g.start, g.end])
    B = tangent_basis(g.normal) * half
    return g.center + np.stack([B[:, 0], B[:, 1], -B[:, 0], -B[:, 1]])
