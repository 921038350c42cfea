"""Messages and files -> Cloud."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.errors import RecordingError
from rigcal.geometry.se3 import Array
from rigcal.plugin import FrameView
from rigcal.recording.cloud import CLOUD_TYPES, read_cloud
from rigcal.recording.message import Message
from rigcal_lrf3d.config import Lrf3dConfig
from rigcal_lrf3d.plane import beams

MESSAGE_TYPES = tuple(CLOUD_TYPES)

_ZERO_M = 1e-6
"""Drivers write missing returns as points at the origin."""


@dataclass(frozen=True, eq=False)
class Cloud:
    """The returns of one exposure: `points` (N, 3), sensor frame, m, in no particular order."""

    points: Array


def decode(message: Message, config: Lrf3dConfig) -> Cloud:
    """The points of a PointCloud2 or cloud file that are finite, not at the origin, within the
    config's ranges and kept by its filter.

    RecordingError if the message has no x, y, z, or if its filter names a field that is not there
    or keeps nothing. A cloud without returns is no error: `detect` says so.
    """
    fields = read_cloud(message)
    missing = [name for name in ("x", "y", "z") if name not in fields]
    if missing:
        raise RecordingError(
            f"{message.origin}: the points have the fields {', '.join(fields)}; "
            f"expected x, y and z ({', '.join(missing)} missing)"
        )
    points = np.column_stack([np.asarray(fields[k], np.float64).ravel() for k in ("x", "y", "z")])
    keep = config.kept(fields, message.origin)
    with np.errstate(invalid="ignore", over="ignore"):
        ranges = np.linalg.norm(points, axis=1)
    low, high = config.limits
    keep &= np.isfinite(ranges) & (ranges > _ZERO_M) & (ranges >= low) & (ranges <= high)
    return Cloud(points[keep])


def view(message: Message, config: Lrf3dConfig) -> FrameView:
    """The cloud as it is used: after the config's filter, without its bias."""
    return FrameView(points=without_bias(decode(message, config).points, config))


def without_bias(points: Array, config: Lrf3dConfig) -> Array:
    """Points (N, 3) moved back along their beams, from the origin, by the config's bias."""
    return points - config.range_bias_m * beams(points)[1] if config.range_bias_m else points
