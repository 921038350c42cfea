"""Cameras for rigcal: lens models, fiducial detection, reprojection residuals, simulation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry.se3 import Array
from rigcal.plugin import Exporter, Importer, SensorType, hookimpl
from rigcal_camera.combine import combine
from rigcal_camera.config import CameraConfig
from rigcal_camera.detector import detect, fit, observe
from rigcal_camera.effects import CameraEffects
from rigcal_camera.exchange import EXPORTERS, IMPORTERS
from rigcal_camera.exchange.camera_info import describe_camera_info
from rigcal_camera.frames import COMPRESSED, FILE_TYPES, IMAGE, decode, view
from rigcal_camera.lens import Lens, lens_of
from rigcal_camera.messages import INFO, camera_info, encode, transport
from rigcal_camera.near import near
from rigcal_camera.refine import LENS
from rigcal_camera.residual import ReprojectionResidual, errors, make_residual, measured_at
from rigcal_camera.simulator import simulate

__all__ = [
    "CAMERA",
    "CameraConfig",
    "CameraEffects",
    "Lens",
    "ReprojectionResidual",
    "decode",
    "detect",
    "encode",
    "errors",
    "fit",
    "lens_of",
    "make_residual",
    "measured_at",
    "observe",
    "simulate",
    "transport",
    "view",
]


def _extra_messages(
    config: CameraConfig, stamp_ns: int, frame_id: str
) -> dict[str, tuple[str, Any]]:
    message = camera_info(config, stamp_ns, frame_id)
    return {"camera_info": (INFO, message)}


def _size(message: Any) -> dict[str, Any]:
    return {"width_px": int(message.width), "height_px": int(message.height)}


def _sees(points: Array, config: CameraConfig) -> NDArray[np.bool_]:
    return lens_of(config).sees(points)


def _project(points: Array, config: CameraConfig) -> tuple[Array, NDArray[np.bool_]]:
    lens = lens_of(config)
    return lens.pixels_from_points(points)[0], lens.sees(points)


CAMERA = SensorType(
    name="camera",
    config=CameraConfig,
    message_types=(IMAGE, COMPRESSED, *FILE_TYPES),
    decode=decode,
    detect=detect,
    combine=combine,
    near=near,
    residual=make_residual,
    errors=errors,
    unit="px",
    measured_at=measured_at,
    observe=observe,
    simulate=simulate,
    effects=CameraEffects,
    encode=encode,
    transport=transport,
    message_type=IMAGE,
    extra_messages=_extra_messages,
    sees=_sees,
    view=view,
    project=_project,
    fit=fit,
    describes={IMAGE: _size, INFO: describe_camera_info},
    angular=True,
    refinable={"lens": LENS},
    bends=True,
)


@hookimpl
def rigcal_sensor_types() -> Sequence[SensorType]:
    """The camera."""
    return [CAMERA]


@hookimpl
def rigcal_exporters() -> Sequence[Exporter]:
    """Files of other tools that hold lenses."""
    return EXPORTERS


@hookimpl
def rigcal_importers() -> Sequence[Importer]:
    """Files of other tools that hold lenses."""
    return IMPORTERS
