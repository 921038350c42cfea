"""What stands in the simulated world: the board, a room, and a person who holds the board."""

from __future__ import annotations

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.scene import Cylinder, Scene, Sphere, Surface
from rigcal.targets import Target
from rigcal_sim.objects import (
    BoxConfig,
    CylinderConfig,
    DecoyConfig,
    ObjectConfig,
    RectangleConfig,
    SphereConfig,
    read_texture,
)
from rigcal_sim.poses import board_pose
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
_SQUARE = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
_UPRIGHT = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
"""Columns: right, up and outward axes of a rectangle that faces along x."""
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
        polygon = _SQUARE * half
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


def object_shapes(
    thing: ObjectConfig, target: Target, T_w_t: Array, rng: np.random.Generator
) -> tuple[Surface | Cylinder | Sphere, ...]:
    """One object of the scenario; `rng` says where a decoy stands."""
    match thing:
        case RectangleConfig():
            texture = None if thing.texture is None else read_texture(thing.texture)
            T_w_f = thing.T_w_o @ se3.transform(_UPRIGHT, np.zeros(3))
            polygon = _SQUARE * np.array(thing.size_m) / 2
            return (Surface(T_w_f, polygon, thing.grey, texture),)
        case BoxConfig():
            greys = dict.fromkeys(_WALL_GREYS, thing.grey)
            return box_faces(thing.T_w_o, np.array(thing.size_m), greys)
        case CylinderConfig():
            return (Cylinder(thing.T_w_o, thing.radius_m, thing.height_m, thing.grey),)
        case SphereConfig():
            return (Sphere(thing.T_w_o, thing.radius_m, thing.grey),)
        case DecoyConfig():
            return (Surface(decoy_pose(thing, T_w_t, rng), target.outline, thing.grey),)


def decoy_pose(decoy: DecoyConfig, T_w_t: Array, rng: np.random.Generator) -> Array:
    """A random pose (4, 4) in the world, beside the target at `T_w_t`."""
    bearing = np.degrees(np.arctan2(T_w_t[1, 3], T_w_t[0, 3]))
    bearing += rng.choice([-1.0, 1.0]) * rng.uniform(*decoy.beside_deg)
    radius, most = rng.uniform(*decoy.radius_m), decoy.max_angle_deg
    return board_pose(bearing, radius, float(T_w_t[2, 3]), rng.uniform(-most, most, 3))


def build_scene(
    target: Target, T_w_t: Array, scenario: ScenarioConfig, rng: np.random.Generator
) -> Scene:
    """The scene of one exposure in frame w; `rng` puts up what moves from exposure to exposure."""
    surfaces: tuple[Surface, ...] = ()
    if scenario.room is not None:
        surfaces += room_surfaces(scenario.room, scenario.floor_m)
    if scenario.person:
        surfaces += person_surfaces(target, T_w_t, scenario.floor_m)
    solids: list[Cylinder | Sphere] = []
    for thing in scenario.objects:
        for shape in object_shapes(thing, target, T_w_t, rng):
            if isinstance(shape, Surface):
                surfaces += (shape,)
            else:
                solids.append(shape)
    return Scene(target, T_w_t, surfaces, tuple(solids))
