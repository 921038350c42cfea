"""Nominal beams of each kind of scan, and where they reach."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal_lrf3d.scans import DepthScan, MultibeamScan, RosetteScan, Scan, SpinningScan

Mask = NDArray[np.bool_]
_ORIGIN = np.zeros(3)
_SLACK = 1e-9
"""Rounding of angles (rad) at the rim of a view."""


def beams_of(scan: Scan, rng: np.random.Generator) -> tuple[Array, Array]:
    """Origins (N, 3) or (3,) m and unit directions (N, 3) of one cloud's beams, sensor frame.

    `rng` is used by patterns that differ from frame to frame.
    """
    match scan:
        case SpinningScan():
            return _spinning_beams(scan)
        case MultibeamScan():
            return _ORIGIN, _multibeam_directions(scan)
        case RosetteScan():
            return _ORIGIN, _rosette_directions(scan, rng)
        case DepthScan():
            return _ORIGIN, _pixel_directions(scan)


def reaches(scan: Scan, points: Array) -> Mask:
    """(N,) towards which points (N, 3) of the sensor's frame some beam of the scan goes.

    The gaps between beams do not count.
    """
    match scan:
        case SpinningScan():
            return _in_turn(points, scan)
        case MultibeamScan():
            elevation = np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]))
            low, high = np.radians([min(scan.elevations_deg), max(scan.elevations_deg)])
            return np.asarray((elevation >= low - _SLACK) & (elevation <= high + _SLACK))
        case RosetteScan():
            off = np.arctan2(np.hypot(points[:, 1], points[:, 2]), points[:, 0])
            return np.asarray(off <= np.radians(scan.fov_deg / 2) + _SLACK)
        case DepthScan():
            reach = np.array([scan.width_px, scan.height_px]) / 2 / scan.focal_px
            ahead = np.maximum(points[:, :1], 0.0)
            return np.asarray(np.all(np.abs(points[:, 1:]) < reach * ahead, axis=1))


def _spinning_beams(scan: SpinningScan) -> tuple[Array, Array]:
    """Every scan in its own frame l (x forward), taken to the sensor's frame by its pose T_s_l."""
    count = int(np.floor((scan.angle_max_deg - scan.angle_min_deg) / scan.angle_step_deg + 1e-6))
    beam = np.radians(scan.angle_min_deg + scan.angle_step_deg * np.arange(count + 1))
    d_l = np.stack([np.cos(beam), np.sin(beam), np.zeros_like(beam)], axis=-1)
    T_s_l = scan_poses(scan)
    directions = d_l @ np.swapaxes(T_s_l[:, :3, :3], 1, 2)
    origins = np.broadcast_to(T_s_l[:, None, :3, 3], directions.shape)
    return origins.reshape(-1, 3), directions.reshape(-1, 3)


def scan_poses(scan: SpinningScan) -> Array:
    """(K, 4, 4) poses T_s_l of the 2D laser (x forward, scan plane z = 0), one per scan.

    The turn is centred on the sensor's x axis.
    """
    count = round(scan.scan_angle_deg * scan.scans_per_deg)
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


def _multibeam_directions(scan: MultibeamScan) -> Array:
    elevation = np.radians(np.asarray(scan.elevations_deg))
    count = max(round(360.0 / scan.azimuth_step_deg), 1)
    azimuth = np.radians(-180.0 + scan.azimuth_step_deg * np.arange(count))[:, None]
    flat = np.cos(elevation)
    return np.stack(
        [flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation) + 0 * azimuth], axis=-1
    ).reshape(-1, 3)


def _rosette_directions(scan: RosetteScan, rng: np.random.Generator) -> Array:
    """Both prisms' deflections, angles as vectors (towards y, towards z), add up."""
    t = np.arange(scan.points_per_frame) / scan.point_rate_hz
    turns = t[:, None] * np.array(scan.rotation_hz) + rng.random(2)
    deflection = np.radians(scan.fov_deg / 4) * np.exp(2j * np.pi * turns).sum(axis=1)
    off, around = np.abs(deflection), np.angle(deflection)
    y, z = np.sin(off) * np.cos(around), np.sin(off) * np.sin(around)
    return np.column_stack([np.cos(off), y, z])


def _pixel_directions(scan: DepthScan) -> Array:
    left = (scan.width_px - 1) / 2 - np.arange(scan.width_px)
    up = (scan.height_px - 1) / 2 - np.arange(scan.height_px)
    y, z = np.meshgrid(left / scan.focal_px, up / scan.focal_px)
    rays = np.column_stack([np.ones(y.size), y.ravel(), z.ravel()])
    result: Array = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return result


def _in_turn(points: Array, scan: SpinningScan) -> Mask:
    """Which points a side of the turning scan plane passes, the offset being left aside.

    A beam at angle b of a plane that leans by a goes to `[sin a cos b, sin b, cos a cos b]`,
    turned about z.
    """
    ranges = np.maximum(np.linalg.norm(points, axis=1), 1e-12)
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    lean = np.radians(scan.tilt_deg)
    cosine = points[:, 2] / ranges / np.cos(lean)
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    low, high, half = np.radians([scan.angle_min_deg, scan.angle_max_deg, scan.scan_angle_deg / 2])
    seen = np.zeros(len(points), dtype=bool)
    for beam in (angle, -angle):
        at_rest = np.arctan2(np.sin(beam), np.sin(lean) * np.cos(beam))
        turn = (azimuth - at_rest + np.pi) % (2 * np.pi) - np.pi
        seen |= (beam >= low - _SLACK) & (beam <= high + _SLACK) & (np.abs(turn) <= half + _SLACK)
    return np.asarray(seen & (np.abs(cosine) <= 1 + _SLACK))
