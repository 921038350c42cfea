"""OpenCV's YAML (FileStorage): one file per camera."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rigcal.geometry.se3 import Array
from rigcal.plugin import Calibration, Exporter, Rig
from rigcal_camera.config import CameraConfig
from rigcal_camera.exchange.cameras import cameras_of


def opencv_texts(calibration: Calibration, rig: Rig | None) -> Mapping[str, str]:
    """NAME.yaml per camera with the names of OpenCV's own samples, and R, T as in stereoCalibrate.

    `p_camera = R p_root + T`: what projectPoints takes (R as a rotation vector) for points of the
    root sensor's frame.
    """
    return {
        f"{name}.yaml": _text(calibration.T(name, calibration.root), calibration.root, config)
        for name, config in cameras_of(calibration, rig).items()
    }


def camera_matrix(config: CameraConfig) -> Array:
    """(3, 3)."""
    (fx, fy), (cx, cy) = config.focal_px, config.principal_px
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def _text(T_camera_root: Array, root: str, config: CameraConfig) -> str:
    import cv2

    mode = cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | cv2.FILE_STORAGE_FORMAT_YAML
    file = cv2.FileStorage("", mode)
    for line in (
        "Calibrated by rigcal. The camera's frame is optical: z forward, x right, y down.",
        f"p_camera = R p_root + T, in metres; the root sensor is {root}; no quaternions.",
        "distortion_model: pinhole is calib3d's (k1, k2, p1, p2, k3, ...), fisheye cv2.fisheye's.",
    ):
        file.writeComment(line)
    file.write("image_width", config.width_px)
    file.write("image_height", config.height_px)
    file.write("distortion_model", config.model)
    file.write("camera_matrix", camera_matrix(config))
    distortion = np.array(config.distortion or (0.0,) * 4).reshape(-1, 1)
    file.write("distortion_coefficients", distortion)
    file.write("root", root)
    file.write("R", np.ascontiguousarray(T_camera_root[:3, :3]))
    file.write("T", np.ascontiguousarray(T_camera_root[:3, 3:]))
    text: str = file.releaseAndGetString()
    return text


OPENCV = Exporter("opencv", "OpenCV FileStorage: lens and pose per camera", opencv_texts, True)
