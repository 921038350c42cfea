"""Images out: the ROS messages of a camera."""

from __future__ import annotations

from typing import Any

import numpy as np

from rigcal_camera.config import CameraConfig
from rigcal_camera.effects import CameraEffects
from rigcal_camera.frames import COMPRESSED, IMAGE, Image

INFO = "sensor_msgs/msg/CameraInfo"


def encode(image: Image, config: CameraConfig, stamp_ns: int, frame_id: str) -> Any:
    """A mono8 sensor_msgs/msg/Image."""
    from rigcal.recording import ros

    height, width = image.shape
    return ros.make(
        IMAGE,
        header=ros.header(stamp_ns, frame_id),
        height=height,
        width=width,
        encoding="mono8",
        is_bigendian=0,
        step=width,
        data=np.ascontiguousarray(image).reshape(-1),
    )


def transport(message: Any, effects: CameraEffects) -> Any:
    """A mono8 Image as a scenario wants it sent: in colour, or as a JPEG CompressedImage."""
    import cv2

    from rigcal.recording import ros

    grey = message.data.reshape(message.height, message.width)
    channels = 1 if effects.encoding == "mono8" else 3
    pixels = grey if channels == 1 else np.repeat(grey[:, :, None], channels, axis=2)
    if effects.jpeg_quality is not None:
        data = cv2.imencode(".jpg", pixels, (cv2.IMWRITE_JPEG_QUALITY, effects.jpeg_quality))[1]
        return ros.make(COMPRESSED, header=message.header, format="jpeg", data=data)
    if channels == 1:
        return message
    return ros.make(
        IMAGE,
        header=message.header,
        height=message.height,
        width=message.width,
        encoding=effects.encoding,
        is_bigendian=0,
        step=message.width * channels,
        data=pixels,
    )


def camera_info(config: CameraConfig, stamp_ns: int, frame_id: str) -> Any:
    """The intrinsics as a sensor_msgs/msg/CameraInfo (`equidistant` is OpenCV's fisheye)."""
    from rigcal.recording import ros

    (fx, fy), (cx, cy) = config.focal_px, config.principal_px
    count = len(config.distortion)
    if config.model == "fisheye":
        name, length = "equidistant", 4
    elif count <= 5:
        name, length = "plumb_bob", 5
    else:
        name, length = "rational_polynomial", count
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return ros.make(
        INFO,
        header=ros.header(stamp_ns, frame_id),
        height=config.height_px,
        width=config.width_px,
        distortion_model=name,
        d=np.pad(np.array(config.distortion, dtype=np.float64), (0, length - count)),
        k=K,
        r=np.eye(3),
        p=np.column_stack([K, np.zeros(3)]),
    )
