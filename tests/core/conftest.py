"""A rig of ideal sensors that look in five directions, and what they see of boards around it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import plane_of_target
from rigcal.observation import (
    Candidate,
    Geometry,
    LineGeometry,
    Observation,
    PlaneGeometry,
    PointGeometry,
    PoseGeometry,
)
from rigcal.plugin import SensorConfig, SensorType, hookimpl
from rigcal.plugin.registry import Registry
from rigcal.rig import Rig, parse_rig

SIGMA = 0.003
BOARD = {"type": "checkerboard", "columns": 8, "rows": 5, "square_size_m": 0.1}
BOARD |= {"width_m": 1.0, "height_m": 0.8}


class IdealConfig(SensorConfig, frozen=True):
    type: Literal["ideal"] = "ideal"
    kind: Literal["pose", "plane", "line", "point"] = "pose"
    bearing_deg: float = 0.0


class Ideal:
    @hookimpl
    def rigcal_sensor_types(self) -> list[SensorType]:
        def unused(*_: object) -> None:
            raise AssertionError("these tests hand over observations")

        return [SensorType("ideal", IdealConfig, (".none",), unused, unused)]


@dataclass(frozen=True)
class Ring:
    """The rig, the poses `T_root_s` of its sensors, and what they saw."""

    rig: Rig
    registry: Registry
    T_root: dict[str, Array]
    observations: tuple[Observation, ...]


def _pose_of(config: IdealConfig, rng: np.random.Generator) -> Array:
    yaw = np.radians(config.bearing_deg)
    turn = se3.rotation_from_rpy(np.array([0.0, 0.0, yaw]))
    if config.kind in ("pose", "point"):  # as cameras: z forward, x right
        turn = turn @ se3.rotation_from_rpy(np.radians([-90.0, 0.0, -90.0]))
    tilt = se3.exp_so3(rng.normal(0, 0.03, 3))
    return se3.transform(turn @ tilt, np.array([0.2 * np.cos(yaw), 0.2 * np.sin(yaw), 0.1]))


def see(kind: str, T_s_t: Array, rng: np.random.Generator, sigma: float) -> Geometry | None:
    """What a sensor sees of a board, with noise of `sigma`; covariances are those of SIGMA."""
    n, d = plane_of_target(T_s_t)
    if kind == "pose":
        noisy = T_s_t @ se3.exp(rng.normal(0, sigma, 6))
        return PoseGeometry(noisy, np.eye(6) * SIGMA**2)
    if kind == "point":
        p_t = np.array([0.2, 0.1, 0.0])
        p = se3.apply(T_s_t, p_t) + rng.normal(0, sigma, 3)
        return PointGeometry(p, np.eye(3) * SIGMA**2, p_t)
    if kind == "plane":
        m = se3.exp_so3(np.cross(n, rng.normal(0, sigma, 3))) @ n
        center = T_s_t[:3, 3] + n * rng.normal(0, sigma)
        return PlaneGeometry(m, float(-m @ center), center, np.eye(3) * SIGMA**2)
    along = np.array([-n[1], n[0], 0.0]) / np.hypot(n[0], n[1])
    across = np.array([along[1], -along[0], 0.0])
    foot = -float(d) * n[:2] / (n[0] ** 2 + n[1] ** 2)
    middle = np.append(foot, 0.0)
    middle += along * (along @ (T_s_t[:3, 3] - middle))
    if abs(se3.apply(se3.inverse(T_s_t), middle)[1]) > 0.3:
        return None
    noise = across * rng.normal(0, sigma / 3, (2, 1))
    ends = middle + np.outer([-0.3, 0.3], along) + noise
    return LineGeometry(ends[0], ends[1], np.eye(6) * (SIGMA / 3) ** 2)


def _boards(rng: np.random.Generator, count: int) -> list[Array]:
    """Poses `T_w_t` all around, facing the rig."""
    poses = []
    for bearing in np.arange(count) * 2 * np.pi / count:
        facing = np.column_stack([[0, 1, 0], [0, 0, 1], [1, 0, 0]]) @ np.diag([-1.0, 1.0, -1.0])
        turn = se3.rotation_from_rpy(np.array([0.0, 0.0, bearing]))
        place = np.array([rng.uniform(1.5, 2.5), rng.uniform(-0.2, 0.2), rng.uniform(-0.1, 0.1)])
        R = turn @ se3.exp_so3(rng.uniform(-0.7, 0.7, 3)) @ facing
        poses.append(se3.transform(R, turn @ place))
    return poses


MakeRing = Callable[..., Ring]


@pytest.fixture
def make_ring() -> MakeRing:
    """`make_ring(seed, kinds={name: (kind, bearing_deg)}, count, outliers, sigma)`: a `Ring`."""

    def make(
        seed: int = 0,
        kinds: dict[str, tuple[str, float]] | None = None,
        count: int = 60,
        outliers: float = 0.0,
        sigma: float = SIGMA,
    ) -> Ring:
        rng = np.random.default_rng(seed)
        kinds = kinds or {
            "lidar": ("plane", 0.0),
            **{f"cam{i}": ("pose", 72.0 * i) for i in range(5)},
            "scan": ("line", 10.0),
        }
        sensors = {
            name: {"type": "ideal", "topic": name, "kind": kind, "bearing_deg": bearing}
            for name, (kind, bearing) in kinds.items()
        }
        registry = Registry([Ideal()])
        root = next(iter(kinds))
        content = {"version": 1, "root": root, "targets": {"board": BOARD}, "sensors": sensors}
        rig = parse_rig(content, registry)
        T_w = {name: _pose_of(config, rng) for name, config in rig.sensors.items()}
        poses = {name: se3.inverse(T_w[root]) @ T for name, T in T_w.items()}
        observations = []
        for k, T_w_t in enumerate(_boards(rng, count)):
            for name, config in rig.sensors.items():
                T_s_t = se3.inverse(T_w[name]) @ T_w_t
                observations.append(_observe(name, config, k, T_s_t, rng, outliers, sigma))
        return Ring(rig, registry, poses, tuple(observations))

    return make


def _observe(
    name: str,
    config: IdealConfig,
    exposure: int,
    T_s_t: Array,
    rng: np.random.Generator,
    outliers: float,
    sigma: float,
) -> Observation:
    ahead = T_s_t[2, 3] if config.kind in ("pose", "point") else T_s_t[0, 3]
    in_view = config.kind == "plane" or ahead > 0.6 * np.linalg.norm(T_s_t[:3, 3])
    if rng.uniform() < outliers:
        T_s_t = T_s_t @ se3.exp(rng.normal(0, 0.2, 6))
    geometry = see(config.kind, T_s_t, rng, sigma) if in_view else None
    candidates: Sequence[Candidate] = () if geometry is None else (Candidate(geometry, {}),)
    return Observation(name, str(exposure), 0, f"{name}{exposure}", tuple(candidates), "not seen")
