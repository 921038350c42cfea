"""A simulated 3D laser (MSG-Cal dissertation, section 4.4.1) and its messages."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.errors import ConfigError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.plugin import Effects
from rigcal.recording.cloud import cloud_message
from rigcal.scene import Scene
from rigcal_lrf3d.cloud import Cloud
from rigcal_lrf3d.config import Lrf3dConfig, MultibeamScan, SpinningScan

MESSAGE_TYPE = "sensor_msgs/msg/PointCloud2"
NO_EFFECTS = Effects()


def simulate(
    T_w_s: Array,
    scene: Scene,
    config: Lrf3dConfig,
    rng: np.random.Generator,
    effects: Effects = NO_EFFECTS,
) -> Cloud:
    """The cloud of a sensor at `T_w_s` in `scene`, in the sensor's frame.

    Each beam leaves at its nominal direction plus noise, meets the nearest surface (eq. 4.10 to
    4.12), and reports a point along the nominal direction at the range plus noise. Beams that meet
    nothing within the range limits give no point. ConfigError if the config has no `scan`.
    """
    origins, directions = scan_beams(config)
    turned = _perturbed(directions, np.radians(config.sigma_angle_deg), rng)
    R, t = T_w_s[:3, :3], T_w_s[:3, 3]
    ranges, _ = scene.cast(origins @ R.T + t, turned @ R.T)
    ranges = ranges + rng.normal(0.0, config.sigma_m, len(ranges))
    low, high = config.range_min_m or 0.0, config.range_max_m or np.inf
    hit = np.isfinite(ranges) & (ranges > low) & (ranges <= high)
    return Cloud(origins[hit] + ranges[hit, None] * directions[hit])


def scan_beams(config: Lrf3dConfig) -> tuple[Array, Array]:
    """Nominal origins (N, 3) m and unit directions (N, 3) of one cloud's beams, sensor frame."""
    match config.scan:
        case SpinningScan():
            return _spinning_beams(config.scan)
        case MultibeamScan():
            return _multibeam_beams(config.scan)
        case None:
            raise ConfigError(
                "an lrf3d sensor lacks `scan`: to simulate it, write for example "
                "scan: {pattern: multibeam, elevations_deg: [-15, -13, 13, 15], "
                "azimuth_step_deg: 0.2}"
            )


def _spinning_beams(scan: SpinningScan) -> tuple[Array, Array]:
    """Every scan in its own frame l (x forward), taken to the sensor's frame by its pose T_s_l."""
    count = int(np.floor((scan.angle_max_deg - scan.angle_min_deg) / scan.angle_step_deg + 1e-6))
    beam = np.radians(scan.angle_min_deg + scan.angle_step_deg * np.arange(count + 1))
    d_l = np.stack([np.cos(beam), np.sin(beam), np.zeros_like(beam)], axis=-1)
    T_s_l = scan_poses(scan)
    directions = np.einsum("kij,nj->kni", T_s_l[:, :3, :3], d_l)
    origins = np.broadcast_to(T_s_l[:, None, :3, 3], directions.shape)
    return origins.reshape(-1, 3), directions.reshape(-1, 3)


def scan_poses(scan: SpinningScan) -> Array:
    """(K, 4, 4) poses T_s_l of the 2D laser (x forward, scan plane z = 0), one per scan.

    The turn is centred on the sensor's x axis.
    """
    count = max(round(scan.scan_angle_deg * scan.scans_per_deg), 1)
    turn = np.radians((np.arange(count) - (count - 1) / 2) / scan.scans_per_deg)
    lean = np.radians(scan.tilt_deg)
    forward = np.array([np.sin(lean), 0.0, np.cos(lean)])
    side = np.array([0.0, 1.0, 0.0])
    T_r_l = se3.transform(
        np.column_stack([forward, side, np.cross(forward, side)]),
        np.array([scan.offset_m, 0.0, 0.0]),
    )
    T_s_r = se3.transform(se3.exp_so3(turn[:, None] * np.array([0.0, 0.0, 1.0])), np.zeros(3))
    result: Array = T_s_r @ T_r_l
    return result


def _multibeam_beams(scan: MultibeamScan) -> tuple[Array, Array]:
    elevation = np.radians(np.asarray(scan.elevations_deg))
    count = max(round(360.0 / scan.azimuth_step_deg), 1)
    azimuth = np.radians(-180.0 + scan.azimuth_step_deg * np.arange(count))[:, None]
    flat = np.cos(elevation)
    directions = np.stack(
        [flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation) + 0 * azimuth], axis=-1
    ).reshape(-1, 3)
    return np.zeros_like(directions), directions


def _perturbed(directions: Array, sigma_rad: float, rng: np.random.Generator) -> Array:
    """Unit directions (N, 3) turned by noise of `sigma_rad` in each of the two angles."""
    if sigma_rad == 0:
        return directions
    noise = rng.normal(0.0, sigma_rad, directions.shape)
    noise -= np.einsum("ni,ni->n", noise, directions)[:, None] * directions
    turned = directions + noise
    result: Array = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    return result


def sees(points: Array, config: Lrf3dConfig) -> NDArray[np.bool_]:
    """(N,) which points (N, 3) of the sensor's frame lie within its scan's angles and its ranges.

    Limits that the config leaves open are none.
    """
    ranges = np.linalg.norm(points, axis=1)
    low, high = config.range_min_m or 0.0, config.range_max_m or np.inf
    good: NDArray[np.bool_] = (ranges > low) & (ranges <= high)
    if config.scan is None:
        return good
    elevation = np.degrees(np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1])))
    if isinstance(config.scan, MultibeamScan):
        low, high = min(config.scan.elevations_deg), max(config.scan.elevations_deg)
        good &= (elevation >= low) & (elevation <= high)
    else:
        good &= _in_turn(points, elevation, config.scan)
    return good


def _in_turn(points: Array, elevation: Array, scan: SpinningScan) -> NDArray[np.bool_]:
    """Which points a side of the turning scan plane passes, beams at +90 deg first on +y."""
    azimuth = np.degrees(np.arctan2(points[:, 1], points[:, 0]))
    seen = np.zeros(len(points), dtype=bool)
    for side, reach in ((90.0, scan.angle_max_deg), (-90.0, -scan.angle_min_deg)):
        from_middle = np.abs((azimuth - side + 180.0) % 360.0 - 180.0)
        seen |= (from_middle <= scan.scan_angle_deg / 2) & (90.0 - elevation <= reach)
    return seen


def encode(cloud: Cloud, config: Lrf3dConfig, stamp_ns: int, frame_id: str) -> Any:
    """A PointCloud2 with x, y, z in float32."""
    x, y, z = cloud.points.astype(np.float32).T
    return cloud_message({"x": x, "y": y, "z": z}, stamp_ns, frame_id)
