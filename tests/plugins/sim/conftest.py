"""A sensor with 19 beams over the front half, so that these tests need no other plugin."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray
from pydantic import Field

from rigcal.observation import Detection
from rigcal.plugin import Effects, Registry, SensorConfig, SensorType, hookimpl
from rigcal.recording.message import Message
from rigcal.rig import Rig, parse_rig
from rigcal.scene import Scene


class RangerConfig(SensorConfig, frozen=True):
    type: Literal["ranger"] = "ranger"
    range_max_m: float = 10.0
    sigma_m: float = 0.01


class RangerEffects(Effects, frozen=True):
    drop_outs: float = Field(default=0.0, ge=0, le=1)


ANGLES = np.radians(np.linspace(-90, 90, 19))


def simulate(
    T_w_s: NDArray[np.float64], scene: Scene, config: Any, rng: np.random.Generator, effects: Any
) -> NDArray[np.float64]:
    d_s = np.column_stack([np.cos(ANGLES), np.sin(ANGLES), 0 * ANGLES])
    ranges, _ = scene.cast(T_w_s[:3, 3], d_s @ T_w_s[:3, :3].T)
    ranges = ranges + rng.normal(0, config.sigma_m, len(ranges))
    return np.where(rng.random(len(ranges)) < effects.drop_outs, np.inf, ranges)


def encode(frame: NDArray[np.float64], config: Any, stamp_ns: int, frame_id: str) -> Any:
    from rigcal.recording import ros

    header = ros.header(stamp_ns, frame_id)
    return ros.make("sensor_msgs/msg/LaserScan", header=header, ranges=frame)


def decode(message: Message, config: Any) -> NDArray[np.float64]:
    return np.asarray(message.value.ranges)


def detect(frame: Any, config: Any, target: Any) -> Detection:
    return Detection((), "it never detects")


def sees(points: NDArray[np.float64], config: Any) -> NDArray[np.bool_]:
    near = np.linalg.norm(points, axis=1) <= config.range_max_m
    result: NDArray[np.bool_] = near & (points[:, 0] >= 0)
    return result


RANGER = SensorType(
    name="ranger",
    config=RangerConfig,
    message_types=("sensor_msgs/msg/LaserScan",),
    decode=decode,
    detect=detect,
    simulate=simulate,
    encode=encode,
    message_type="sensor_msgs/msg/LaserScan",
    effects=RangerEffects,
    sees=sees,
)


@pytest.fixture
def registry() -> Registry:
    @hookimpl
    def rigcal_sensor_types() -> list[SensorType]:
        return [RANGER]

    return Registry([SimpleNamespace(rigcal_sensor_types=rigcal_sensor_types)])


@pytest.fixture
def make_rig(registry: Registry) -> Callable[..., Rig]:
    """Two rangers, b above a and turned by 20 degrees; keywords change b's entry."""

    def make(**changes: Any) -> Rig:
        pose = {"parent": "a", "rpy_deg": [0.0, 0.0, 20.0], "translation_m": [0.1, 0.0, 0.2]}
        board = {"type": "checkerboard", "columns": 7, "rows": 5, "square_size_m": 0.1}
        a = {"type": "ranger", "topic": "/a/scan"}
        b = {"type": "ranger", "topic": "/b/scan", "pose": pose} | changes
        sensors = {"a": a, "b": b}
        rig = {"version": 1, "root": "a", "targets": {"board": board}, "sensors": sensors}
        return parse_rig(rig, registry)

    return make
