"""Images in and out: ROS messages and image files to grey uint8 arrays (H, W), and back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.errors import RecordingError
from rigcal.recording.message import Message
from rigcal_camera.config import CameraConfig

FILE_TYPES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")
IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"

_CHANNELS = {"mono": 1, "rgb": 3, "bgr": 3, "rgba": 4, "bgra": 4}
_CHANNELS |= {f"bayer_{order}": 1 for order in ("rggb", "bggr", "gbrg", "grbg")}
_ENCODINGS = {f"{name}{bits}": (name, bits) for name in _CHANNELS for bits in (8, 16)}
_ENCODINGS |= {"8UC1": ("mono", 8), "16UC1": ("mono", 16)}

Image = NDArray[np.uint8]


def decode(message: Message, config: CameraConfig) -> Image:
    """The grey image (H, W) of a message or file.

    RecordingError when it cannot be decoded, or when its size is not that of the rig file.
    """
    if message.type == IMAGE:
        image = _from_raw(message)
    elif message.type == COMPRESSED:
        image = _from_encoded(np.asarray(message.value.data, dtype=np.uint8), message)
    else:
        image = _from_encoded(_file_bytes(message), message)
    height, width = image.shape
    if (width, height) != (config.width_px, config.height_px):
        raise RecordingError(
            f"{message.origin}: the image is {width} x {height} px, the rig file says "
            f"{config.width_px} x {config.height_px} (width_px x height_px). Intrinsics hold for "
            "one size only: correct the rig file or take the images it was written for"
        )
    return image


def _file_bytes(message: Message) -> NDArray[np.uint8]:
    try:
        return np.fromfile(Path(message.value), dtype=np.uint8)
    except OSError as error:
        raise RecordingError(f"{message.origin}: cannot be read: {error.strerror}") from error


def _from_encoded(data: NDArray[np.uint8], message: Message) -> Image:
    import cv2

    # The lens model belongs to the sensor's pixels: an orientation tag must not turn them.
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        image = cv2.imdecode(data, flags) if len(data) else None
    except cv2.error:
        image = None
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise RecordingError(
            f"{message.origin}: {len(data)} bytes that are not an image "
            "(png, jpeg, tiff and bmp with 8 or 16 bits are read); the file may be cut short"
        )
    return _to_8_bits(image)


def _from_raw(message: Message) -> Image:
    """Grey image of a sensor_msgs/msg/Image; rows may be padded (`step`)."""
    value = message.value
    if value.encoding not in _ENCODINGS:
        known = ", ".join(sorted(_ENCODINGS))
        raise RecordingError(
            f"{message.origin}: image encoding '{value.encoding}' is not read (known: {known})"
        )
    layout, bits = _ENCODINGS[value.encoding]
    height, width, step = int(value.height), int(value.width), int(value.step)
    row = width * _CHANNELS[layout] * bits // 8
    data = np.asarray(value.data, dtype=np.uint8)
    # Some writers leave out the padding of the last row.
    if height * width == 0 or step < row or len(data) < step * (height - 1) + row:
        raise RecordingError(
            f"{message.origin}: {len(data)} bytes do not hold a {width} x {height} image of "
            f"encoding {value.encoding} with a step of {step} bytes"
        )
    padded = np.zeros(step * height, dtype=np.uint8)
    padded[: len(data)] = data[: len(padded)]
    byte_order = ">" if value.is_bigendian else "<"
    pixels = np.ascontiguousarray(padded.reshape(height, step)[:, :row])
    pixels = pixels.view(f"{byte_order}u{bits // 8}")
    return _to_grey(_to_8_bits(pixels.reshape(height, width, -1)), layout)


def _to_8_bits(image: NDArray[Any]) -> Image:
    """16-bit data shifted so that the highest bit in use becomes the highest of 8.

    Cameras of 10 and 12 bits fill the low bits of 16 as often as the high ones.
    """
    if image.dtype.itemsize == 1:
        return np.ascontiguousarray(image)
    bits = max(int(image.max(initial=0)).bit_length(), 8)
    return (image >> (bits - 8)).astype(np.uint8)


def _to_grey(pixels: Image, layout: str) -> Image:
    import cv2

    if _CHANNELS[layout] == 1 and not layout.startswith("bayer"):
        return pixels[:, :, 0]
    name = layout.upper().replace("BAYER_", "Bayer")
    return np.asarray(cv2.cvtColor(pixels, getattr(cv2, f"COLOR_{name}2GRAY")), dtype=np.uint8)


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
        "sensor_msgs/msg/CameraInfo",
        header=ros.header(stamp_ns, frame_id),
        height=config.height_px,
        width=config.width_px,
        distortion_model=name,
        d=np.pad(np.array(config.distortion, dtype=np.float64), (0, length - count)),
        k=K,
        r=np.eye(3),
        p=np.column_stack([K, np.zeros(3)]),
    )
