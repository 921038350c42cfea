"""Directions all around, and boards that face a viewer."""

from __future__ import annotations

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array


def sphere(count: int) -> Array:
    """(count, 3) unit directions, evenly spread (Fibonacci lattice)."""
    k = np.arange(count) + 0.5
    z = 1 - 2 * k / count
    turn = np.pi * (1 + np.sqrt(5)) * k
    flat = np.sqrt(1 - z**2)
    return np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])


def circle(count: int) -> Array:
    """(count, 3) unit directions in the plane z = 0."""
    turn = 2 * np.pi * np.arange(count) / count
    return np.column_stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)])


def facing(away: Array, up: Array, rpy_deg: Array) -> Array:
    """`R_a_t` (3, 3) of a board whose back is turned `away` from a viewer, both unit vectors (3,).

    Its upper edge is level; then it is rotated by roll about its normal, pitch about its
    horizontal axis x, yaw about its y.
    """
    side = np.cross(up, -away)
    # Straight above or below the viewer every edge is level.
    if np.linalg.norm(side) < 1e-6:
        side = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    side = side / np.linalg.norm(side)
    R_a_level = np.column_stack([side, np.cross(-away, side), -away])
    roll, pitch, yaw = np.radians(rpy_deg)
    axes = np.eye(3)
    R = se3.exp_so3(yaw * axes[1]) @ se3.exp_so3(pitch * axes[0]) @ se3.exp_so3(roll * axes[2])
    result: Array = R_a_level @ R
    return result
