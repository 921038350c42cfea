"""Ideal sensors that say what they see of a board, on a small rig."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal.geometry.directions import facing
from rigcal.geometry.se3 import Array
from rigcal.observation import Observation
from rigcal.plugin import SensorConfig, SensorType, hookimpl
from rigcal.plugin.registry import Registry
from rigcal.rig import Rig, T_root_sensors, build_targets, parse_rig
from rigcal.testing.features import Kind, observe
from rigcal.visibility import spots_in_view

BOARD = {"type": "checkerboard", "columns": 8, "rows": 5, "square_size_m": 0.1}
BOARD |= {"width_m": 1.0, "height_m": 0.8}
SIGMA = 0.003


class EyeConfig(SensorConfig, frozen=True):
    """A camera: measures the pose, sees up to 40 degrees off its z axis."""

    optical: ClassVar[bool] = True
    type: Literal["eye"] = "eye"
    kind: Kind = "pose"


class GaugeConfig(SensorConfig, frozen=True):
    """A laser: measures a plane, sees up to 60 degrees off its x axis."""

    type: Literal["gauge"] = "gauge"
    kind: Kind = "plane"


class SlitConfig(SensorConfig, frozen=True):
    """The same in its plane z = 0 only: measures a line."""

    type: Literal["slit"] = "slit"
    kind: Kind = "line"


class MuteConfig(SensorConfig, frozen=True):
    """A sensor that does not say what it would see."""

    type: Literal["mute"] = "mute"


def _sees(forward: Sequence[float], most_deg: float) -> Any:
    def sees(p_s: Array, config: Any) -> Any:
        along = p_s @ np.array(forward) / np.maximum(np.linalg.norm(p_s, axis=1), 1e-9)
        return along > np.cos(np.radians(most_deg))

    return sees


def _observe(T_s_t: Array, config: Any, target: Any, rng: np.random.Generator) -> Any:
    return observe(config.kind, T_s_t, target, rng, SIGMA)


def _unused(*_: object) -> Any:
    raise AssertionError("these tests hand over observations")


class Sensors:
    @hookimpl
    def rigcal_sensor_types(self) -> list[SensorType]:
        made = (".none",), _unused, _unused
        eye = SensorType("eye", EyeConfig, *made, observe=_observe, sees=_sees((0, 0, 1), 40.0))
        gauge = SensorType("gauge", GaugeConfig, *made, observe=_observe, sees=_sees((1, 0, 0), 60))
        slit = replace(gauge, name="slit", config=SlitConfig, flat=True)
        return [eye, gauge, slit, replace(gauge, name="mute", config=MuteConfig, observe=None)]


def _pose(x: float, y: float, z: float, yaw: float = 0.0, optical: bool = False) -> dict[str, Any]:
    rpy = [-90.0, 0.0, -90.0 + yaw] if optical else [0.0, 0.0, yaw]
    return {"parent": "gauge", "translation_m": [x, y, z], "rpy_deg": rpy}


SENSORS: dict[str, dict[str, Any]] = {
    "gauge": {"type": "gauge"},
    "left": {"type": "eye", "pose": _pose(0.1, 0.2, 0.1, 20.0, optical=True)},
    "right": {"type": "eye", "pose": _pose(0.1, -0.2, 0.1, -20.0, optical=True)},
    "slit": {"type": "slit", "pose": _pose(0.2, 0.0, -0.2)},
    "back": {"type": "eye", "pose": _pose(-0.3, 0.0, 0.1, 180.0, optical=True)},
    "mute": {"type": "mute", "pose": _pose(0.0, 0.1, 0.0)},
}


@dataclass(frozen=True)
class Bench:
    """Makes rigs of some of the sensors, and observes boards with them."""

    registry: Registry

    def rig(self, *names: str, changes: Mapping[str, Mapping[str, Any]] | None = None) -> Rig:
        entries = {n: SENSORS[n] | (changes or {}).get(n, {}) for n in names}
        content = {"version": 1, "root": names[0], "targets": {"board": BOARD}, "sensors": entries}
        return parse_rig(content, self.registry)

    def observe(self, rig: Rig, boards: Sequence[Array], seed: int = 0) -> list[Observation]:
        """What those sensors see of boards at `T_root_t` that can tell, and have them in view."""
        rng = np.random.default_rng(seed)
        (target,) = build_targets(rig, self.registry).values()
        found = []
        for k, T_root_t in enumerate(boards):
            for name, T_root_s in T_root_sensors(rig).items():
                config = rig.sensors[name]
                kind, T_s_t = (
                    self.registry.sensor_type(config.type),
                    se3.inverse(T_root_s) @ T_root_t,
                )
                candidate = None
                if kind.observe and len(spots_in_view(T_s_t, kind, config, target)):
                    candidate = kind.observe(T_s_t, config, target, rng)
                own = () if candidate is None else (candidate,)
                found.append(Observation(name, str(k), 0, f"{name} {k}", own, "not in view"))
        return found


@pytest.fixture(scope="session")
def bench() -> Bench:
    return Bench(Registry([Sensors()]))


def boards(
    rng: np.random.Generator, count: int, tilt_deg: float = 35.0, toward: float = 0.0
) -> list[Array]:
    """`T_root_t` of boards 1.5 to 3 m ahead (`toward` rad to the left), turned to the rig but for
    tilts up to `tilt_deg` about each axis. Without tilt they are parallel.
    """
    ahead, up = np.array([np.cos(toward), np.sin(toward), 0.0]), np.array([0.0, 0.0, 1.0])
    left = np.cross(up, ahead)
    places = rng.uniform([1.5, -0.5, -0.2], [3.0, 0.5, 0.3], (count, 3))
    return [
        se3.transform(
            facing(ahead, up, rng.uniform(-tilt_deg, tilt_deg, 3)),
            np.stack([ahead, left, up]).T @ p,
        )
        for p in places
    ]


@pytest.fixture(scope="session")
def make_boards() -> Any:
    return boards
