"""What stands in the simulated world: the board, a room, and a person who holds the board."""

from __future__ import annotations

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.scene import Scene, Surface
from rigcal.targets import Target
from rigcal_sim.scenario import RoomConfig, ScenarioConfig

_CLEARANCE_M = 0.08
_TORSO_WIDTH_M, _TORSO_DEPTH_M = 0.45, 0.25
_PERSON: tuple[tuple[float, float, tuple[float, float], float, float], ...] = (
    # from, to (heights over the floor), size across and along, offset across, grey
    (0.0, 0.85, (0.16, 0.20), -0.11, 0.20),
    (0.0, 0.85, (0.16, 0.20), 0.11, 0.20),
    (0.85, 1.48, (_TORSO_WIDTH_M, _TORSO_DEPTH_M), 0.0, 0.35),
    (1.50, 1.76, (0.18, 0.22), 0.0, 0.70),
)
_WALL_GREYS = {(0, -1): 0.62, (0, 1): 0.58, (1, -1): 0.66, (1, 1): 0.54, (2, -1): 0.35, (2, 1): 0.8}


def box_faces(
    T_w_b: Array, size: Array, greys: dict[tuple[int, int], float], inward: bool = False
) -> tuple[Surface, ...]:
    """The six faces of a box of `size` (3,) centred on frame b, normals outward or inward.

    `greys` are by (axis, side).
    """
    axes = np.eye(3)
    faces = []
    for (axis, side), grey in greys.items():
        first, second = (axis + 1) % 3, (axis + 2) % 3
        if (side < 0) != inward:
            first, second = second, first
        normal = -side if inward else side
        R = np.column_stack([axes[first], axes[second], normal * axes[axis]])
        half = np.array([size[first], size[second]]) / 2
        polygon = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
        T_b_f = se3.transform(R, side * size[axis] / 2 * axes[axis])
        faces.append(Surface(T_w_b @ T_b_f, polygon, grey))
    return tuple(faces)


def room_surfaces(room: RoomConfig, floor_m: float) -> tuple[Surface, ...]:
    """Walls, floor and ceiling, seen from inside."""
    size = np.array(room.size_m)
    center = np.array([*room.center_m, floor_m + size[2] / 2])
    return box_faces(se3.transform(np.eye(3), center), size, _WALL_GREYS, inward=True)


def person_surfaces(target: Target, T_w_t: Array, floor_m: float) -> tuple[Surface, ...]:
    """Somebody who stands close behind the board: legs, torso and head as boxes."""
    away = T_w_t[:2, 3] / np.linalg.norm(T_w_t[:2, 3])
    across = np.array([-away[1], away[0]])
    steps = np.linspace(-0.5, 0.5, 9)
    grid = np.stack(np.meshgrid(steps, steps, [0.0]), axis=-1).reshape(-1, 3)
    spots = se3.apply(T_w_t, grid * [*target.size, 0.0])[:, :2] - T_w_t[:2, 3]
    near = np.abs(spots @ across) <= _TORSO_WIDTH_M / 2 + _CLEARANCE_M
    behind = float(np.max(spots[near] @ away)) + _CLEARANCE_M + _TORSO_DEPTH_M / 2
    R_w_p = np.column_stack([[*across, 0.0], [*away, 0.0], [0.0, 0.0, -1.0]])
    faces: tuple[Surface, ...] = ()
    for low, high, (width, depth), offset, grey in _PERSON:
        xy = T_w_t[:2, 3] + behind * away + offset * across
        T_w_b = se3.transform(R_w_p, np.array([*xy, floor_m + (low + high) / 2]))
        size = np.array([width, depth, high - low])
        faces += box_faces(T_w_b, size, dict.fromkeys(_WALL_GREYS, grey))
    return faces


def build_scene(target: Target, T_w_t: Array, scenario: ScenarioConfig) -> Scene:
    """The scene of one exposure in frame w."""
    surfaces: tuple[Surface, ...] = ()
    if scenario.room is not None:
        surfaces += room_surfaces(scenario.room, scenario.floor_m)
    if scenario.person:
        surfaces += person_surfaces(target, T_w_t, scenario.floor_m)
    return Scene(target, T_w_t, surfaces)
