"""A simulated room with a person who holds the board, seen by two kinds of 3D laser."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.scene import Scene, Surface
from rigcal.targets.target import Target, TargetConfig
from rigcal_lrf3d import Lrf3dConfig

VLP16 = {"pattern": "multibeam", "elevations_deg": [float(e) for e in range(-15, 16, 2)]}
SPINNING = {"pattern": "spinning_lrf", "tilt_deg": 10.0, "offset_m": 0.05, "angle_step_deg": 1.5}

MakeScene = Callable[[Array, Target], Scene]


def _rectangle(T_w_f: Array, width: float, height: float) -> Surface:
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.array([width, height]) / 2
    return Surface(T_w_f, corners)


def _box(T_w_b: Array, size: tuple[float, float, float]) -> list[Surface]:
    """The six faces of a box of `size` about the origin of its frame b."""
    faces = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (-0.5, 0.5):
            R, t = np.zeros((3, 3)), np.zeros(3)
            R[u, 0] = R[v, 1] = R[axis, 2] = 1.0
            t[axis] = side * size[axis]
            faces.append(_rectangle(T_w_b @ se3.transform(R, t), size[u], size[v]))
    return faces


def _at(x: float, y: float, z: float, yaw: float = 0.0) -> Array:
    return se3.transform(se3.exp_so3(np.array([0.0, 0.0, yaw])), np.array([x, y, z]))


def _room() -> list[Surface]:
    """Seven by nine metres around a sensor 1.1 m above the floor; tables, a shelf, a column."""
    return [
        *_box(_at(0.5, 0.5, 0.4), (7.0, 9.0, 3.0)),
        *_box(_at(3.2, -3.0, -0.7, 0.1), (1.4, 0.8, 0.8)),
        *_box(_at(-2.7, 3.6, -0.1), (0.4, 1.6, 2.0)),
        *_box(_at(2.5, 3.8, -0.5, 0.4), (0.3, 0.3, 1.2)),
        *_box(_at(-1.0, -3.2, -0.8, 0.8), (0.6, 0.6, 0.6)),
    ]


def _person(T_w_t: Array, size: Array) -> list[Surface]:
    """Stands behind the board, holds its left and right edges with both hands."""
    p_w = T_w_t[:3, 3]
    yaw = float(np.arctan2(p_w[1], p_w[0]))
    back = p_w + 0.45 * np.array([np.cos(yaw), np.sin(yaw), 0.0])
    parts = [
        *_box(_at(back[0], back[1], -0.65, yaw), (0.2, 0.3, 0.9)),
        *_box(_at(back[0], back[1], 0.1, yaw), (0.25, 0.45, 0.6)),
        *_box(_at(back[0], back[1], 0.5, yaw), (0.2, 0.16, 0.24)),
    ]
    for side in (-1.0, 1.0):
        hand = T_w_t @ _at(side * size[0] / 2, 0.1, 0.0)
        arm = T_w_t @ _at(side * (size[0] / 2 + 0.04), 0.1, -0.2)
        parts += _box(hand, (0.1, 0.09, 0.06)) + _box(arm, (0.07, 0.07, 0.4))
    return parts


@pytest.fixture
def board() -> Target:
    outline = np.array([[-0.6, -0.45], [0.6, -0.45], [0.6, 0.45], [-0.6, 0.45]])
    return Target("board", TargetConfig(type="plain"), outline, np.zeros((0, 3)))


@pytest.fixture(params=["multibeam", "spinning"])
def config(request: pytest.FixtureRequest) -> Lrf3dConfig:
    if request.param == "multibeam":
        return Lrf3dConfig.model_validate({"scan": VLP16, "sigma_m": 0.012, "range_max_m": 30.0})
    return Lrf3dConfig.model_validate({"scan": SPINNING, "sigma_m": 0.01, "range_max_m": 30.0})


@pytest.fixture
def room() -> MakeScene:
    """Builds a scene with the board at `T_w_t`, the sensor being at the world's origin."""

    def build(T_w_t: Array, target: Target) -> Scene:
        return Scene(target, T_w_t, tuple(_room() + _person(T_w_t, target.size)))

    return build


@pytest.fixture
def empty_room(board: Target) -> Scene:
    return Scene(board, None, tuple(_room()))


@pytest.fixture
def board_poses() -> Callable[[int, int], list[Array]]:
    """`count` poses T_w_t of a board that faces the sensor, 1.6 to 2.6 m away on all sides."""

    def poses(count: int, seed: int) -> list[Array]:
        rng = np.random.default_rng(seed)
        upright = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
        result = []
        for _ in range(count):
            bearing, reach = rng.uniform(-np.pi, np.pi), rng.uniform(1.6, 2.6)
            turn = se3.rotation_from_rpy(np.radians(rng.uniform(-40, 40, 3)))
            face = se3.exp_so3(np.array([0.0, 0.0, bearing])) @ turn @ upright
            height = rng.uniform(-0.2, 0.2)
            where = [reach * np.cos(bearing), reach * np.sin(bearing), height]
            result.append(se3.transform(face, np.array(where)))
        return result

    return poses
