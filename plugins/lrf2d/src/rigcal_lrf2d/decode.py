"""Messages and files -> Scan."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.errors import RecordingError
from rigcal.geometry.se3 import Array
from rigcal.plugin import FrameView
from rigcal.recording.cloud import CLOUD_TYPES, read_cloud
from rigcal.recording.message import Message
from rigcal_lrf2d.config import Lrf2dConfig
from rigcal_lrf2d.scan import Scan, directions, scan_from_polar
from rigcal_lrf2d.tables import read_table

LASER_SCAN = "sensor_msgs/msg/LaserScan"
MESSAGE_TYPES = tuple(dict.fromkeys((LASER_SCAN, ".csv", ".npy", *CLOUD_TYPES)))

_MAX_ELEVATION_SPREAD_DEG = 1.0
"""Points of one ring have one elevation; two rings differ by more than this."""

Fields = Mapping[str, NDArray[Any]]


def decode(message: Message, config: Lrf2dConfig) -> Scan:
    """The scan in a LaserScan, in x and y of a cloud's points, or in a table of two columns.

    RecordingError on data that are no scan. A scan without any return is no error: `detect` says
    so.
    """
    if message.type == LASER_SCAN:
        _refuse_filter(message, config)
        return _from_laser_scan(message, config)
    is_table = message.type in (".csv", ".npy")
    table = read_table(Path(message.value), message.origin) if is_table else read_cloud(message)
    fields = _filtered(table, message, config)
    if "angle_rad" in fields:
        if not np.all(np.isfinite(fields["angle_rad"])):
            raise RecordingError(
                f"{message.origin}: an angle is not finite; expected a number of rad for each "
                "beam (a beam without return has range inf)"
            )
        return scan_from_polar(fields["angle_rad"], fields["range_m"], config)
    return _from_points(fields, message, config)


def view(message: Message, config: Lrf2dConfig) -> FrameView:
    """The returns of a scan as points (N, 3) of the sensor's frame, without the config's bias."""
    scan = decode(message, config)
    ranges, angles = scan.ranges[scan.valid], scan.angles[scan.valid]
    return FrameView(points=(ranges - config.range_bias_m)[:, None] * directions(angles))


def describe(message: Any) -> dict[str, Any]:
    """The angles of a LaserScan as fields of a config; none if they are no scan anticlockwise."""
    low, high, step = (
        round(float(np.degrees(value)), 4)
        for value in (message.angle_min, message.angle_max, message.angle_increment)
    )
    if not 0 < step < high - low <= 360:
        return {}
    return {"angle_min_deg": low, "angle_max_deg": high, "angle_step_deg": step}


def _from_laser_scan(message: Message, config: Lrf2dConfig) -> Scan:
    """Beam i at `angle_min + i * angle_increment`, as the ROS message defines it.

    0, negative, NaN, infinite ranges and those beyond the message's limits are no returns.
    """
    scan = message.value
    ranges: Array = np.asarray(scan.ranges, dtype=np.float64)
    first, step = float(scan.angle_min), float(scan.angle_increment)
    if len(ranges) == 0:
        raise RecordingError(f"{message.origin}: the LaserScan has no ranges")
    if not (np.isfinite(first) and np.isfinite(step)) or (step == 0 and len(ranges) > 1):
        raise RecordingError(
            f"{message.origin}: the LaserScan has angle_min {first:g} and angle_increment "
            f"{step:g}; expected finite angles and an increment other than 0"
        )
    turn = abs(step) * (len(ranges) - 1)
    if turn > 2 * np.pi + 1.5 * abs(step):
        raise RecordingError(
            f"{message.origin}: the LaserScan's {len(ranges)} beams of {step:g} rad cover "
            f"{np.degrees(turn):.0f} deg; expected one revolution (is angle_increment in rad?)"
        )
    low, high = float(scan.range_min), float(scan.range_max)
    limits = (low, high) if high > low >= 0 else (0.0, np.inf)
    # The message holds floats: a range at the limit may be just beyond it in double.
    limits = (limits[0] * (1 - 1e-6), limits[1] * (1 + 1e-6))
    angles: Array = first + step * np.arange(len(ranges), dtype=np.float64)
    return scan_from_polar(angles, ranges, config, limits)


def _from_points(fields: Fields, message: Message, config: Lrf2dConfig) -> Scan:
    """Angle and range of x and y. Points that are not finite or at the origin are no returns."""
    x, y = (np.asarray(fields[name], dtype=np.float64) for name in ("x", "y"))
    finite = np.isfinite(x) & np.isfinite(y) & ((x != 0) | (y != 0))
    if "z" in fields:
        _check_one_ring(np.asarray(fields["z"], np.float64)[finite], x[finite], y[finite], message)
    x, y = x[finite], y[finite]
    angles: Array = np.arctan2(y, x)
    ranges: Array = np.hypot(x, y)
    return scan_from_polar(angles, ranges, config)


def _check_one_ring(z: Array, x: Array, y: Array, message: Message) -> None:
    """RecordingError if the points lie on more than one cone about the z axis."""
    if len(z) == 0:
        return
    low, high = np.percentile(np.degrees(np.arctan2(z, np.hypot(x, y))), [5, 95])
    if high - low > _MAX_ELEVATION_SPREAD_DEG:
        raise RecordingError(
            f"{message.origin}: the points lie between {low:.1f} and {high:.1f} deg of elevation; "
            "expected one scan (all within 1 deg): keep one ring of the cloud, for example "
            "`filter: {ring: 8}`"
        )


def _filtered(fields: Fields, message: Message, config: Lrf2dConfig) -> Fields:
    """The rows that the config's filter keeps; RecordingError if there are none."""
    keep = config.kept(fields, message.origin)
    if not keep.any():
        raise RecordingError(f"{message.origin}: there are no points in it")
    return {name: np.asarray(values)[keep] for name, values in fields.items()}


def _refuse_filter(message: Message, config: Lrf2dConfig) -> None:
    if config.filter:
        raise RecordingError(
            f"{message.origin}: filter {dict(config.filter)} is for clouds, but this is a "
            "LaserScan; remove `filter`, or use range_min_m and range_max_m"
        )
