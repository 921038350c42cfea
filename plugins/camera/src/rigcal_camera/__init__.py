"""Cameras for rigcal: lens models, fiducial detection, reprojection residuals, simulation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry.se3 import Array
from rigcal.plugin import SensorType, hookimpl
from rigcal_camera.config import CameraConfig
from rigcal_camera.detector import detect, observe
from rigcal_camera.frames import COMPRESSED, FILE_TYPES, IMAGE, camera_info, decode, encode
from rigcal_camera.lens import Lens, lens_of
from rigcal_camera.residual import ReprojectionResidual, errors, make_residual
from rigcal_camera.simulator import simulate

__all__ = [
    "CAMERA",
    "CameraConfig",
    "Lens",
    "ReprojectionResidual",
    "decode",
    "detect",
    "encode",
    "errors",
    "lens_of",
    "make_residual",
    "observe",
    "simulate",
]


def _extra_messages(
    config: CameraConfig, stamp_ns: int, frame_id: str
) -> dict[str, tuple[str, Any]]:
    message = camera_info(config, stamp_ns, frame_id)
    return {"camera_info": ("sensor_msgs/msg/CameraInfo", message)}


def _sees(points: Array, config: CameraConfig) -> NDArray[np.bool_]:
    return lens_of(config).sees(points)


CAMERA = SensorType(
    name="camera",
    config=CameraConfig,
    message_types=(IMAGE, COMPRESSED, *FILE_TYPES),
    decode=decode,
    detect=detect,
    residual=make_residual,
    errors=errors,
    unit="px",
    observe=observe,
    simulate=simulate,
    encode=encode,
    message_type=IMAGE,
    extra_messages=_extra_messages,
    sees=_sees,
)


@hookimpl
def rigcal_sensor_types() -> Sequence[SensorType]:
    """The camera."""
    return [CAMERA]
