"""A cart with two cameras, a 3D and a 2D laser, and what they see of boards around it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.observation import Observation
from rigcal.plugin.registry import Registry
from rigcal.rig import Rig, T_root_sensors, build_targets, parse_rig

LENS = {
    "focal_px": [600.0, 602.0],
    "principal_px": [615.5, 511.5],
    "distortion": [-0.1, 0.02, 0.001, -0.0005],
}
BOARD = {
    "type": "apriltag_grid", "columns": 4, "rows": 3, "tag_size_m": 0.2, "tag_gap_m": 0.06,
    "width_m": 1.2, "height_m": 0.9,
}  # fmt: skip


def _camera(y: float, yaw: float) -> dict[str, Any]:
    pose = {"parent": "lidar", "translation_m": [0.1, y, 0.2], "rpy_deg": [-90, 0, -90 + yaw]}
    size = {"width_px": 1232, "height_px": 1024}
    return {"type": "camera", "topic": "image", "pose": pose, **size, **LENS}


SENSORS: dict[str, dict[str, Any]] = {
    "lidar": {
        "type": "lrf3d", "topic": "cloud", "sigma_m": 0.01,
        "scan": {
            "pattern": "multibeam", "azimuth_step_deg": 0.5,
            "elevations_deg": np.linspace(-25, 15, 24).tolist(),
        },
    },
    "left": _camera(0.3, 10.0),
    "right": _camera(-0.3, -10.0),
    "scan": {
        "type": "lrf2d", "topic": "scan", "sigma_m": 0.01, "angle_min_deg": -135.0,
        "angle_max_deg": 135.0, "angle_step_deg": 0.5,
        "pose": {"parent": "lidar", "translation_m": [0.2, 0.0, -0.2], "rpy_deg": [0, 0, 0]},
    },
}  # fmt: skip

FIT = {"camera": ("uv", "index"), "lrf3d": ("points",), "lrf2d": ("angles", "ranges")}

Changes = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class Cart:
    """Makes rigs of some of the sensors, and records boards with the true ones."""

    registry: Registry

    def rig(self, sensors: Sequence[str], changes: Changes | None = None) -> Rig:
        """The first sensor is the root; `changes` to the sensors' and the board's entries."""
        return parse_rig(self.content(sensors, changes), self.registry)

    def content(self, sensors: Sequence[str], changes: Changes | None = None) -> dict[str, Any]:
        """The same as rig.yaml holds it."""
        changes = changes or {}
        entries = {name: SENSORS[name] | changes.get(name, {}) for name in sensors}
        if "lidar" not in sensors:
            entries = {n: {k: v for k, v in e.items() if k != "pose"} for n, e in entries.items()}
        target = {"board": BOARD | changes.get("board", {})}
        return {"version": 1, "root": sensors[0], "targets": target, "sensors": entries}

    @property
    def truth(self) -> dict[str, Array]:
        """`T_lidar_s` of all sensors."""
        return T_root_sensors(self.rig(list(SENSORS)))

    def record(
        self,
        rng: np.random.Generator,
        boards: Sequence[Array],
        sensors: Sequence[str],
        changes: Changes | None = None,
        bend: Sequence[float] | None = None,
    ) -> list[Observation]:
        """What the sensors, changed, see of boards at `T_lidar_t`.

        Boards may be bent; first poses and what counts as theirs are those of flat ones.
        """
        rig = self.rig(list(SENSORS), changes)
        (flat,) = build_targets(rig, self.registry).values()
        target = flat if bend is None else flat.bent(np.array(bend))
        found = []
        for k, T_lidar_t in enumerate(boards):
            for name in sensors:
                config = rig.sensors[name]
                kind = self.registry.sensor_type(config.type)
                observe = kind.observe
                assert observe is not None
                T_s_t = se3.inverse(self.truth[name]) @ T_lidar_t
                candidate = observe(T_s_t, config, target, rng)
                candidates = () if candidate is None else (candidate,)
                if bend is not None and candidates and kind.fit is not None:
                    measured = {n: candidates[0].measurement[n] for n in FIT[config.type]}
                    candidates = kind.fit(measured, config, flat).candidates
                found.append(Observation(name, str(k), 0, f"{name} {k}", candidates, "not in view"))
        return found


@pytest.fixture(scope="package")
def cart() -> Cart:
    return Cart(Registry.from_entry_points())


MakeBoards = Callable[..., list[Array]]


@pytest.fixture(scope="package")
def make_boards() -> MakeBoards:
    """`make_boards(rng, count, bearing_deg, distance_m, tilt)`: poses `T_lidar_t`, facing it.

    `tilt` is the largest angle (rad) about each axis, x forwards, z up.
    """

    def make(
        rng: np.random.Generator,
        count: int = 24,
        bearing_deg: float = 70.0,
        distance_m: tuple[float, float] = (1.2, 4.0),
        tilt: float | Sequence[float] = 0.6,
    ) -> list[Array]:
        facing = np.array([[0.0, 0, -1], [1, 0, 0], [0, 1, 0]])
        facing[:, 0] = np.cross(facing[:, 1], facing[:, 2])
        poses = []
        for _ in range(count):
            yaw = np.radians(rng.uniform(-bearing_deg, bearing_deg))
            turn = se3.exp_so3(np.array([0.0, 0.0, yaw]))
            place = np.array([rng.uniform(*distance_m), 0.0, rng.uniform(-0.4, 0.4)])
            R = turn @ se3.exp_so3(rng.uniform(-1, 1, 3) * tilt) @ facing
            poses.append(se3.transform(R, turn @ place))
        return poses

    return make
