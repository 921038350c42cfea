"""A simulated 3D laser (MSG-Cal dissertation, section 4.4.1) and its messages."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.errors import ConfigError
from rigcal.geometry.se3 import Array
from rigcal.ranging import RangeEffects, measure, turned
from rigcal.recording.cloud import cloud_message
from rigcal.scene import Scene
from rigcal_lrf3d.beams import beams_of, reaches
from rigcal_lrf3d.cloud import Cloud
from rigcal_lrf3d.config import Lrf3dConfig

MESSAGE_TYPE = "sensor_msgs/msg/PointCloud2"
NO_EFFECTS = RangeEffects()


def simulate(
    T_w_s: Array,
    scene: Scene,
    config: Lrf3dConfig,
    rng: np.random.Generator,
    effects: RangeEffects = NO_EFFECTS,
) -> Cloud:
    """The cloud of a sensor at `T_w_s` in `scene`, in the sensor's frame.

    Each beam leaves at its nominal direction plus noise and gives a point along the nominal
    direction, at the range that `rigcal.ranging.measure` says. Beams without return give no point.
    ConfigError if the config has no `scan`.
    """
    if config.scan is None:
        raise ConfigError(
            "an lrf3d sensor lacks `scan`: to simulate it, or to plan for it, write for example "
            "scan: {pattern: multibeam, elevations_deg: [-15, -13, 13, 15], azimuth_step_deg: 0.2}"
        )
    origins, directions = beams_of(config.scan, rng)
    aimed = turned(directions, effects.noise * config.noise.angle_rad, rng)
    R, t = T_w_s[:3, :3], T_w_s[:3, 3]
    ranges = measure(scene, origins @ R.T + t, aimed @ R.T, config, effects, rng)
    hit = np.isfinite(ranges)
    starts = origins if origins.ndim == 1 else origins[hit]
    return Cloud(starts + ranges[hit, None] * directions[hit])


def sees(points: Array, config: Lrf3dConfig) -> NDArray[np.bool_]:
    """(N,) which points (N, 3) of the sensor's frame lie within its scan's angles and its ranges.

    Limits that the config leaves open are none.
    """
    ranges = np.linalg.norm(points, axis=1)
    low, high = config.limits
    good: NDArray[np.bool_] = (ranges > 0) & (ranges >= low) & (ranges <= high)
    return good if config.scan is None else good & reaches(config.scan, points)


def encode(cloud: Cloud, config: Lrf3dConfig, stamp_ns: int, frame_id: str) -> Any:
    """A PointCloud2 with x, y, z in float32."""
    x, y, z = cloud.points.astype(np.float32).T
    return cloud_message({"x": x, "y": y, "z": z}, stamp_ns, frame_id)
