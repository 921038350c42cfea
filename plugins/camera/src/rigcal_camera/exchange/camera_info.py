"""sensor_msgs/CameraInfo as YAML, as ROS's camera_info_manager reads it: one file per camera."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rigcal.errors import ConfigError
from rigcal.exporting.text import commented_yaml
from rigcal.geometry.se3 import Array
from rigcal.plugin import Calibration, Exporter, Imported, Importer, Rig
from rigcal_camera.config import CameraConfig
from rigcal_camera.exchange.cameras import cameras_of
from rigcal_camera.exchange.lens import lens_fields
from rigcal_camera.exchange.mapping import mapping_in
from rigcal_camera.messages import camera_info


def camera_info_texts(calibration: Calibration, rig: Rig | None) -> Mapping[str, str]:
    """NAME.yaml per camera. Source of the format: wiki.ros.org/camera_calibration_parsers."""
    cameras = cameras_of(calibration, rig)
    return {f"{name}.yaml": _text(name, config) for name, config in cameras.items()}


def _text(name: str, config: CameraConfig) -> str:
    info = camera_info(config, 0, f"{name}_optical_frame")
    lines = [
        "sensor_msgs/CameraInfo, calibrated by rigcal: a lens, no pose, no quaternion.",
        f"Its frame is optical (z forward, x right, y down): frame_id {info.header.frame_id}.",
        "camera_matrix: pixel = K p_camera / z; (0, 0) is the centre of the top-left pixel.",
    ]
    content = {
        "image_width": info.width,
        "image_height": info.height,
        "camera_name": name,
        "camera_matrix": _matrix(info.k, 3),
        "distortion_model": info.distortion_model,
        "distortion_coefficients": _matrix(info.d, 1),
        "rectification_matrix": _matrix(info.r, 3),
        "projection_matrix": _matrix(info.p, 3),
    }
    return commented_yaml(lines, content)


def _matrix(values: Array, rows: int) -> dict[str, Any]:
    flat = values.ravel().tolist()
    return {"rows": rows, "cols": len(flat) // rows, "data": flat}


def describe_camera_info(message: Any) -> dict[str, Any]:
    """Fields of a camera's config from a CameraInfo of ROS 2, or of ROS 1 (K and D there)."""
    K = message.k if hasattr(message, "k") else message.K
    D = message.d if hasattr(message, "d") else message.D
    size = (message.width, message.height)
    return lens_fields(message.distortion_model, np.reshape(K, (3, 3)), D, size)


def read_camera_info(text: str, stem: str) -> Imported | None:
    """The lens in a file of camera_info_manager; its matrices may be plain lists."""
    content = mapping_in(text)
    if not {"camera_matrix", "image_width"} <= content.keys():
        return None
    K, D = (_numbers(content, key) for key in ("camera_matrix", "distortion_coefficients"))
    size = (_size(content, "image_width"), _size(content, "image_height"))
    model = str(content.get("distortion_model", ""))
    fields = lens_fields(model, K.reshape(3, 3) if K.size == 9 else K, D.tolist(), size)
    return Imported({str(content.get("camera_name", stem)): fields})


def _numbers(content: Mapping[Any, Any], key: str) -> Array:
    """(N,) numbers of a matrix, row by row; none where the key is missing."""
    value = content.get(key) or []
    data = value.get("data", []) if isinstance(value, dict) else value
    try:
        return np.array(data, dtype=np.float64).ravel()
    except (TypeError, ValueError):
        raise ConfigError(
            f"{key}: found {data!r}; write its numbers as `data: [...]`, row by row"
        ) from None


def _size(content: Mapping[Any, Any], key: str) -> int:
    value = content.get(key, 0)
    if not isinstance(value, int):
        raise ConfigError(f"{key}: found {value!r}; write the number of pixels")
    return value


CAMERA_INFO_FILE = Importer("camera-info", "ROS CameraInfo YAML: a lens", read_camera_info)
CAMERA_INFO = Exporter("camera-info", "ROS CameraInfo YAML per camera", camera_info_texts, True)
