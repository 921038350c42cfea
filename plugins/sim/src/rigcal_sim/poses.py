"""Random poses of the board around the rig (MSG-Cal, section 4.4.1)."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from zlib import crc32

import numpy as np

from rigcal.errors import ConfigError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.plugin.registry import Registry
from rigcal.rig import Rig, T_root_sensors
from rigcal.targets import Target
from rigcal_sim.scenario import ScenarioConfig

MAX_DRAWS = 200
_SPACE_FOR_PERSON_M = 1.0
_LEAST_SEEN = 0.5


@dataclass(frozen=True, eq=False)
class BoardPoses:
    """`T_w_t` (N, 4, 4), who sees each, and how often a pose had to be drawn again."""

    T_w_t: Array
    seen_by: tuple[tuple[str, ...], ...]
    redrawn: int


def stream(seed: int, exposure: int, name: str) -> np.random.Generator:
    """Random numbers that depend on these three only, not on order or number of workers."""
    return np.random.default_rng(np.random.SeedSequence([seed, exposure, crc32(name.encode())]))


def board_pose(bearing_deg: float, radius_m: float, height_m: float, rpy_deg: Array) -> Array:
    """`T_w_t` (4, 4) of a board that faces the z axis, rotated by roll, pitch, yaw.

    Roll is about the board's normal, pitch about its horizontal axis x, yaw about its y.
    """
    bearing = np.radians(bearing_deg)
    away = np.array([np.cos(bearing), np.sin(bearing), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    R_w_upright = np.column_stack([np.cross(up, -away), up, -away])
    roll, pitch, yaw = np.radians(rpy_deg)
    axes = np.eye(3)
    R = se3.exp_so3(yaw * axes[1]) @ se3.exp_so3(pitch * axes[0]) @ se3.exp_so3(roll * axes[2])
    return se3.transform(R_w_upright @ R, radius_m * away + height_m * up)


def sensor_poses(rig: Rig, scenario: ScenarioConfig) -> dict[str, Array]:
    """`T_w_s` (4, 4) of every sensor; ConfigError if the rig's poses do not connect them."""
    T_w_root = scenario.root_pose.T_w_root
    return {name: T_w_root @ T for name, T in T_root_sensors(rig).items()}


def sensors_that_see(
    rig: Rig, registry: Registry, target: Target, T_w_t: Array, T_w_s: Mapping[str, Array]
) -> tuple[str, ...]:
    """The sensors that have at least half of the board in their view and look at its face."""
    steps = np.linspace(-0.5, 0.5, 5)
    grid = np.stack(np.meshgrid(steps, steps, [0.0]), axis=-1).reshape(-1, 3)
    p_w = se3.apply(T_w_t, grid * [*target.size, 0.0])
    seen = []
    for name, config in rig.sensors.items():
        in_front = float(T_w_t[:3, 2] @ (T_w_s[name][:3, 3] - T_w_t[:3, 3])) > 0
        sees = registry.sensor_type(config.type).sees
        share = 1.0 if sees is None else sees(se3.apply(se3.inverse(T_w_s[name]), p_w), config)
        if in_front and rig.target_of(name) == target.name and np.mean(share) >= _LEAST_SEEN:
            seen.append(name)
    return tuple(seen)


def sample_board_poses(
    rig: Rig,
    registry: Registry,
    target: Target,
    scenario: ScenarioConfig,
    seed: int,
    poses: int | None = None,
) -> BoardPoses:
    """Board poses over all bearings and radii of the scenario, `samples` each or `poses` in all.

    A pose that fewer than `min_sensors` sensors see, or at which the board (with the person
    behind it) would not fit into the room, is drawn again; ConfigError after 200 draws.
    """
    cells = list(itertools.product(scenario.board.bearings_deg, scenario.board.radii_m))
    count = len(cells) * scenario.board.samples if poses is None else poses
    T_w_s = sensor_poses(rig, scenario)
    drawn, seen_by, redrawn = [], [], 0
    for exposure in range(count):
        cell = cells[exposure * len(cells) // count]
        rng = stream(seed, exposure, "board pose")
        for _ in range(MAX_DRAWS):
            T_w_t = _draw(cell, scenario, rng)
            seen = sensors_that_see(rig, registry, target, T_w_t, T_w_s)
            if len(seen) >= scenario.min_sensors and _has_space(target, T_w_t, scenario):
                break
            redrawn += 1
        else:
            raise ConfigError(_hopeless(cell, scenario, seen))
        drawn.append(T_w_t)
        seen_by.append(seen)
    return BoardPoses(np.array(drawn).reshape(-1, 4, 4), tuple(seen_by), redrawn)


def _draw(cell: tuple[float, float], scenario: ScenarioConfig, rng: np.random.Generator) -> Array:
    board = scenario.board
    limits = np.array([board.max_roll_deg, board.max_pitch_deg, board.max_yaw_deg])
    rpy_deg = rng.uniform(-limits, limits)
    return board_pose(*cell, rng.uniform(*board.heights_m), rpy_deg)


def _has_space(target: Target, T_w_t: Array, scenario: ScenarioConfig) -> bool:
    corners = se3.apply(T_w_t, target.outline_points)
    if scenario.person:
        away = T_w_t[:3, 3] * [1.0, 1.0, 0.0]
        behind = _SPACE_FOR_PERSON_M * away / np.linalg.norm(away)
        corners = np.concatenate([corners, corners + behind])
    fits = bool(np.all(corners[:, 2] > scenario.floor_m))
    if scenario.room is not None:
        length, width, height = scenario.room.size_m
        inside = np.abs(corners[:, :2] - scenario.room.center_m) < np.array([length, width]) / 2
        fits &= bool(inside.all() and np.all(corners[:, 2] < scenario.floor_m + height))
    return fits


def _hopeless(cell: tuple[float, float], scenario: ScenarioConfig, seen: tuple[str, ...]) -> str:
    if len(seen) >= scenario.min_sensors:
        reason = "the board does not fit into the room there: enlarge room.size_m"
    else:
        found = f"only {', '.join(seen)} sees" if seen else "no sensor sees"
        reason = f"{found} it there, expected {scenario.min_sensors} sensors: take others"
    return (
        f"scenario: board at bearing {cell[0]:g} deg, radius {cell[1]:g} m: none of "
        f"{MAX_DRAWS} poses can be used; {reason}"
    )
