"""The smallest useful plugin: a tracker that reports where a prism on the board is.

It reads a file `x,y,z` (m) for each exposure. Residual, calibration with other sensors,
covariances and reports come from core.
"""

from typing import Literal

import numpy as np
from pydantic import PositiveFloat

import rigcal.plugin as rp


class TrackerConfig(rp.SensorConfig, frozen=True):
    """A tracker: x forward, y left, z up."""

    type: Literal["tracker"] = "tracker"
    prism_m: tuple[float, float, float]
    sigma_m: PositiveFloat = 0.002


def decode(message: rp.Message, config: TrackerConfig) -> rp.Array:
    """The prism's place (3,)."""
    try:
        point = np.array(message.value.read_text(encoding="utf-8").split(","), np.float64)
    except (OSError, ValueError) as error:
        raise rp.RecordingError(f"{message.origin}: expected x,y,z in m: {error}") from error
    if point.shape != (3,) or not np.isfinite(point).all():
        raise rp.RecordingError(f"{message.origin}: found {point}, expected x,y,z in m")
    return point


def detect(point: rp.Array, config: TrackerConfig, target: rp.Target) -> rp.Detection:
    """The prism, a known point of the target."""
    covariance = config.sigma_m**2 * np.eye(3)
    geometry = rp.PointGeometry(point, covariance, np.array(config.prism_m))
    return rp.Detection((rp.Candidate(geometry, {"point": point}),))


TRACKER = rp.SensorType("tracker", TrackerConfig, (".csv",), decode, detect)


@rp.hookimpl
def rigcal_sensor_types() -> list[rp.SensorType]:
    """The tracker."""
    return [TRACKER]
