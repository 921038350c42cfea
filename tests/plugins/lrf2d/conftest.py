"""A board, a laser, and a room with a person in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.scene import Scene, Surface
from rigcal.targets.target import Target, TargetConfig
from rigcal_lrf2d import Lrf2dConfig


def rectangle(width: float, height: float) -> Array:
    corners: Array = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [width / 2, height / 2]
    return corners


def wall(center: tuple[float, float], yaw: float, width: float, height: float = 3.0) -> Surface:
    """An upright rectangle that faces along `yaw` (rad)."""
    c, s = np.cos(yaw), np.sin(yaw)
    R = np.array([[-s, 0, c], [c, 0, s], [0, 1, 0]])
    return Surface(se3.transform(R, np.array([*center, 0.0])), rectangle(width, height))


def column(center: Array, radius: float, facets: int = 12) -> list[Surface]:
    """An upright prism, nearly a cylinder: a person's torso or arm."""
    half = np.pi / facets
    yaws = 2 * half * np.arange(facets)
    spots = center + radius * np.cos(half) * np.column_stack([np.cos(yaws), np.sin(yaws)])
    return [
        wall((float(x), float(y)), float(yaw), 2 * radius * np.sin(half), 1.8)
        for (x, y), yaw in zip(spots, yaws, strict=True)
    ]


def room() -> list[Surface]:
    """8 m x 9 m."""
    return [
        wall((5, 0), np.pi, 8),
        wall((-4, 0), 0, 8),
        wall((0, 4), -np.pi / 2, 9),
        wall((0, -4), np.pi / 2, 9),
    ]


@dataclass(frozen=True)
class World:
    """What the tests of this folder share."""

    target: Target
    config: Lrf2dConfig
    pose: Callable[[np.random.Generator], Array]
    scene: Callable[[Array], Scene]


def board_pose(rng: np.random.Generator) -> Array:
    """`T_s_t` of a board 1.2 to 3.2 m away, turned by up to 35 degrees about each axis."""
    bearing, radius = rng.uniform(-2, 2), rng.uniform(1.2, 3.2)
    p = np.array([radius * np.cos(bearing), radius * np.sin(bearing), rng.uniform(-0.2, 0.2)])
    z = -p / np.linalg.norm(p)
    x = np.cross([0, 0, 1], z) / np.hypot(z[0], z[1])
    R = np.column_stack([x, np.cross(z, x), z]) @ se3.exp_so3(rng.uniform(-0.6, 0.6, 3))
    return se3.transform(R, p)


def room_with_person(target: Target, T_s_t: Array) -> Scene:
    """The board held by a person behind it, an arm beside it; a chair leg and a cabinet."""
    p, away = T_s_t[:2, 3], T_s_t[:2, 3] / np.linalg.norm(T_s_t[:2, 3])
    side = np.array([-away[1], away[0]])
    body, arm = column(p + 0.55 * away, 0.2, 10), column(p + 0.75 * side + 0.1 * away, 0.05, 4)
    leg, cabinet = column(p - 1.1 * side, 0.03, 4), wall((4.4, -2.5), np.pi, 0.9)
    return Scene(target, T_s_t, (*room(), *body, *arm, *leg, cabinet))


@pytest.fixture
def world() -> World:
    target = Target("board", TargetConfig(type="plain"), rectangle(1.2, 0.9), np.zeros((0, 3)))
    config = Lrf2dConfig(
        angle_min_deg=-135, angle_max_deg=135, angle_step_deg=0.25, range_max_m=30, sigma_m=0.01
    )
    return World(target, config, board_pose, lambda T: room_with_person(target, T))
