"""OpenCV's YAML (FileStorage): one file per camera."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rigcal.errors import ConfigError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.plugin import Calibration, Exporter, Imported, Importer, Rig
from rigcal_camera.config import CameraConfig
from rigcal_camera.exchange.cameras import cameras_of
from rigcal_camera.exchange.lens import lens_fields


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


def read_opencv(text: str, stem: str) -> Imported | None:
    """The lens in a FileStorage of one camera, called by the stem; its pose if `root` is there.

    The keys are those of OpenCV's own samples: `camera_matrix`, `distortion_coefficients`,
    `image_width`, `image_height`, `fisheye_model`.
    """
    if "!!opencv-matrix" not in text:
        return None
    import cv2

    try:
        file = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    except cv2.error as error:
        raise ConfigError(f"OpenCV cannot read it: {error.err}") from error
    K, D = _matrix(file, "camera_matrix"), _matrix(file, "distortion_coefficients")
    if K is None or D is None:
        raise ConfigError("expected camera_matrix and distortion_coefficients of one camera")
    width, height = (int(file.getNode(f"image_{key}").real()) for key in ("width", "height"))
    fisheye = file.getNode("fisheye_model").real() == 1
    model = "fisheye" if fisheye else file.getNode("distortion_model").string()
    sensors = {stem: lens_fields(model, K, D.ravel().tolist(), (width, height))}
    root, R, T = file.getNode("root").string(), _matrix(file, "R"), _matrix(file, "T")
    if not root or R is None or T is None:
        return Imported(sensors)
    T_root_camera = se3.inverse(se3.transform(se3.nearest_rotation(R), T.ravel()))
    return Imported(sensors, {stem: (root, T_root_camera)})


def _matrix(file: Any, key: str) -> Array | None:
    node = file.getNode(key)
    return None if node.empty() else np.asarray(node.mat(), dtype=np.float64)


OPENCV_FILE = Importer("opencv", "OpenCV FileStorage of one camera: a lens", read_opencv)
OPENCV = Exporter("opencv", "OpenCV FileStorage: lens and pose per camera", opencv_texts, True)
