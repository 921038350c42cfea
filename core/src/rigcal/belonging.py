"""What belongs to a rig: observations and calibrations of another one are refused."""

from __future__ import annotations

from collections.abc import Sequence

from rigcal.calibration import Calibration
from rigcal.errors import ConfigError, ObservationError
from rigcal.observation import Observation
from rigcal.rig import Rig


def check_observations(rig: Rig, observations: Sequence[Observation]) -> None:
    """ObservationError for sensors that are not in the rig, and for two observations of one
    sensor in one exposure, of which only one would count.
    """
    unknown = sorted({o.sensor for o in observations} - set(rig.sensors))
    if unknown:
        raise ObservationError(
            f"observations of {', '.join(unknown)}, which the rig does not name "
            f"(it has {', '.join(rig.sensors)}); use the rig file they were made with"
        )
    first: dict[tuple[str, str], Observation] = {}
    for o in observations:
        other = first.setdefault((o.sensor, o.exposure), o)
        if other is not o and (o.candidates or other.candidates):
            raise ObservationError(
                f"sensor '{o.sensor}', exposure '{o.exposure}': two observations, of "
                f"{other.origin} and {o.origin}; expected one (it may have several candidates): "
                "name exposures differently, or leave one of the two out"
            )


def check_calibration(rig: Rig, calibration: Calibration) -> None:
    """ConfigError for a calibration that places no sensor of the rig but its root."""
    others = [sensor for sensor in rig.sensors if sensor != rig.root]
    if others and not any(sensor in calibration.sensors for sensor in others):
        raise ConfigError(
            f"a calibration of {', '.join(calibration.sensors)} places none of "
            f"{', '.join(others)} of this rig; use the rig file that it was made with"
        )
