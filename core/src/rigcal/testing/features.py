"""What ideal detectors report of a board: observations with noise of the covariance they state."""

from __future__ import annotations

from typing import Literal

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import plane_of_target, tangent_basis
from rigcal.observation import (
    Candidate,
    Geometry,
    LineGeometry,
    PlaneGeometry,
    PointGeometry,
    PoseGeometry,
)
from rigcal.targets.target import Target

Kind = Literal["pose", "plane", "line", "point"]


def observe(
    kind: Kind, T_s_t: Array, target: Target, rng: np.random.Generator, sigma: float = 0.003
) -> Candidate | None:
    """One candidate: rotations with noise of `sigma` rad, places with `sigma` m.

    A line is the chord of the board in the plane z = 0 of the sensor, both ends true edges, located
    along it with 2 sigma; None where there is none. A point is a corner of the board.
    """
    geometry = {"pose": _pose, "plane": _plane, "line": _line, "point": _point}[kind](
        T_s_t, target, rng, sigma
    )
    return None if geometry is None else Candidate(geometry, {})


def facing_boards(count: int, rng: np.random.Generator, tilt: float = 0.6) -> Array:
    """(count, 4, 4) poses `T_s_t` of boards 2 to 4 m along x, in front of a sensor that looks along
    it; they face it, but for turns of up to `tilt` rad about each axis.
    """
    facing = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    R = se3.exp_so3(rng.uniform(-tilt, tilt, (count, 3))) @ facing
    return se3.transform(R, rng.uniform([2.0, -1.0, -0.3], [4.0, 1.0, 0.3], (count, 3)))


def _pose(T_s_t: Array, target: Target, rng: np.random.Generator, sigma: float) -> Geometry:
    return PoseGeometry(T_s_t @ se3.exp(rng.normal(0, sigma, 6)), np.eye(6) * sigma**2)


def _plane(T_s_t: Array, target: Target, rng: np.random.Generator, sigma: float) -> Geometry:
    n, _ = plane_of_target(T_s_t)
    tilted = se3.exp_so3(tangent_basis(n) @ rng.normal(0, sigma, 2)) @ n
    center = T_s_t[:3, 3] + n * rng.normal(0, sigma)
    return PlaneGeometry(tilted, -float(tilted @ center), center, np.eye(3) * sigma**2)


def _point(T_s_t: Array, target: Target, rng: np.random.Generator, sigma: float) -> Geometry:
    p_t = target.outline_points[0]
    position = se3.apply(T_s_t, p_t) + rng.normal(0, sigma, 3)
    return PointGeometry(position, np.eye(3) * sigma**2, p_t)


def _line(T_s_t: Array, target: Target, rng: np.random.Generator, sigma: float) -> Geometry | None:
    """Where the board's outline passes through z = 0, left end (seen from the sensor) last."""
    corners = se3.apply(T_s_t, target.outline_points)
    z = corners[:, 2]
    sides = np.flatnonzero((z > 0) != (np.roll(z, -1) > 0))
    if len(sides) != 2:
        return None
    following = np.roll(corners, -1, axis=0)
    share = z[sides] / (z[sides] - following[sides, 2])
    ends = corners[sides] + share[:, None] * (following - corners)[sides]
    along = ends[1] - ends[0]
    length = float(np.hypot(*along[:2]))
    if length < 0.1:
        return None
    if ends[0, 0] * ends[1, 1] - ends[0, 1] * ends[1, 0] < 0:
        ends, along = ends[::-1], -along
    t = along / length
    across = np.array([-t[1], t[0], 0.0])
    noise = sigma * (np.outer(rng.normal(size=2), across) + np.outer(2 * rng.normal(size=2), t))
    C = sigma**2 * (np.outer(across, across) + 4 * np.outer(t, t))
    # The scan plane is thin, but a covariance has to be positive definite.
    C[2, 2] = 1e-12
    start, end = ends + noise
    return LineGeometry(start, end, np.kron(np.eye(2), C), True, True)
