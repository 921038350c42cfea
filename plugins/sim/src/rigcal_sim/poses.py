"""A pose of the board: random numbers for it, how it faces the viewer, whether it has space."""

from __future__ import annotations

from zlib import crc32

import numpy as np

from rigcal.geometry import directions, se3
from rigcal.geometry.se3 import Array
from rigcal.targets import Target
from rigcal_sim.scenario import ScenarioConfig

_SPACE_FOR_PERSON_M = 1.0
_UP = np.array([0.0, 0.0, 1.0])


def stream(seed: int, exposure: int, name: str) -> np.random.Generator:
    """Random numbers that depend on these three only, not on order or number of workers."""
    return np.random.default_rng(np.random.SeedSequence([seed, exposure, crc32(name.encode())]))


def board_pose(bearing_deg: float, radius_m: float, height_m: float, rpy_deg: Array) -> Array:
    """`T_w_t` (4, 4) of a board that faces the z axis, rotated by roll, pitch, yaw."""
    bearing = np.radians(bearing_deg)
    away = np.array([np.cos(bearing), np.sin(bearing), 0.0])
    return facing(away, radius_m * away + height_m * _UP, rpy_deg)


def facing(away: Array, p_w: Array, rpy_deg: Array) -> Array:
    """`T_w_t` (4, 4) of a board at `p_w` whose back is turned `away`, a unit vector (3,).

    Its upper edge is level but for the rotation of `rigcal.geometry.directions.facing`.
    """
    return se3.transform(directions.facing(away, _UP, rpy_deg), p_w)


def has_space(target: Target, T_w_t: Array, scenario: ScenarioConfig) -> bool:
    """Whether the board, and the person behind it, are above the floor and within the room."""
    corners = se3.apply(T_w_t, target.outline_points)
    if scenario.person:
        away = T_w_t[:3, 3] * [1.0, 1.0, 0.0]
        behind = _SPACE_FOR_PERSON_M * away / max(float(np.linalg.norm(away)), 1e-9)
        corners = np.concatenate([corners, corners + behind])
    fits = bool(np.all(corners[:, 2] > scenario.floor_m))
    if scenario.room is not None:
        length, width, height = scenario.room.size_m
        inside = np.abs(corners[:, :2] - scenario.room.center_m) < np.array([length, width]) / 2
        fits &= bool(inside.all() and np.all(corners[:, 2] < scenario.floor_m + height))
    return fits
