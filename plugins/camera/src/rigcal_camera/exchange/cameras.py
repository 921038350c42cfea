"""The cameras among the sensors of a calibration."""

from __future__ import annotations

from rigcal.errors import InputError
from rigcal.plugin import Calibration, Rig
from rigcal_camera.config import CameraConfig


def cameras_of(calibration: Calibration, rig: Rig | None) -> dict[str, CameraConfig]:
    """Configs by name, in the order of the rig; InputError if there is no camera."""
    assert rig is not None  # the formats of this package need it
    found = {
        name: config
        for name, config in rig.sensors.items()
        if name in calibration.sensors and isinstance(config, CameraConfig)
    }
    if not found:
        raise InputError(
            f"none of the sensors ({', '.join(calibration.sensors)}) is a camera, and this format "
            "holds cameras only"
        )
    return found
