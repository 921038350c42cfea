"""Images in: ROS messages and image files to uint8 arrays, grey (H, W) or RGB (H, W, 3)."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rigcal.errors import RecordingError
from rigcal.plugin import FrameView
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
Colours = Literal["GRAY", "RGB"]


def decode(message: Message, config: CameraConfig) -> Image:
    """The grey image (H, W) of a message or file.

    RecordingError when it cannot be decoded, or when its size is not that of the rig file.
    """
    return _read(message, config, "GRAY")


def view(message: Message, config: CameraConfig) -> FrameView:
    """The image as it was taken: RGB (H, W, 3), or grey (H, W). RecordingError as for `decode`."""
    return FrameView(image=_read(message, config, "RGB"))


def _read(message: Message, config: CameraConfig, colours: Colours) -> Image:
    if message.type == IMAGE:
        image = _from_raw(message, colours)
    elif message.type == COMPRESSED:
        image = _from_encoded(np.asarray(message.value.data, dtype=np.uint8), message, colours)
    else:
        image = _from_encoded(_file_bytes(message), message, colours)
    height, width = image.shape[:2]
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


def _from_encoded(data: NDArray[np.uint8], message: Message, colours: Colours) -> Image:
    import cv2

    # The lens model belongs to the sensor's pixels: an orientation tag must not turn them.
    flags = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    flags |= cv2.IMREAD_GRAYSCALE if colours == "GRAY" else cv2.IMREAD_ANYCOLOR
    try:
        image = cv2.imdecode(data, flags) if len(data) else None
    except cv2.error:
        image = None
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise RecordingError(
            f"{message.origin}: {len(data)} bytes that are not an image "
            "(png, jpeg, tiff and bmp with 8 or 16 bits are read); the file may be cut short"
        )
    image = _to_8_bits(image)
    return image if image.ndim == 2 else _converted(image, "bgr", colours)


def _from_raw(message: Message, colours: Colours) -> Image:
    """Pixels of a sensor_msgs/msg/Image; rows may be padded (`step`)."""
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
    return _converted(_to_8_bits(pixels.reshape(height, width, -1)), layout, colours)


def _to_8_bits(image: NDArray[Any]) -> Image:
    """16-bit data shifted so that the highest bit in use becomes the highest of 8.

    Cameras of 10 and 12 bits fill the low bits of 16 as often as the high ones.
    """
    if image.dtype.itemsize == 1:
        return np.ascontiguousarray(image)
    bits = max(int(image.max(initial=0)).bit_length(), 8)
    return (image >> (bits - 8)).astype(np.uint8)


def _converted(pixels: Image, layout: str, colours: Colours) -> Image:
    """Pixels (H, W, C) in grey (H, W), or in RGB unless they are grey."""
    import cv2

    if layout == "mono":
        return pixels[:, :, 0]
    if layout == "rgb" and colours == "RGB":
        return pixels
    name = layout.upper().replace("BAYER_", "Bayer")
    converted = cv2.cvtColor(pixels, getattr(cv2, f"COLOR_{name}2{colours}"))
    return np.asarray(converted, dtype=np.uint8)
