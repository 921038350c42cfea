"""Lenses of other tools as fields of a camera's config."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rigcal.errors import ConfigError
from rigcal.geometry.se3 import Array

MODELS = {
    "plumb_bob": "pinhole",
    "rational_polynomial": "pinhole",
    "radtan": "pinhole",
    "none": "pinhole",
    "pinhole": "pinhole",
    "equidistant": "fisheye",
    "fisheye": "fisheye",
    "": "pinhole",
}
"""rigcal's model by the names of ROS, Kalibr and OpenCV."""


def lens_fields(
    model: str, K: Array, distortion: Sequence[float], size: tuple[int, int] | None
) -> dict[str, Any]:
    """Fields of a `CameraConfig` from a camera matrix (3, 3); `size` is width, height in pixels.

    A matrix of zeros, as of a camera that was never calibrated, gives no lens. ConfigError for a
    lens model that rigcal does not have, and for a matrix with skew.
    """
    fields: dict[str, Any] = {"type": "camera"}
    if size is not None and min(size) > 0:
        fields |= {"width_px": int(size[0]), "height_px": int(size[1])}
    K = np.asarray(K, dtype=np.float64)
    if K.shape != (3, 3) or not np.isfinite(K).all():
        raise ConfigError(
            f"the camera matrix has shape {K.shape}, expected 3 x 3 finite numbers; write all "
            "nine, or leave the file out and give focal_px and principal_px in rig.yaml"
        )
    if K[0, 0] == 0:
        return fields
    if model not in MODELS:
        known = ", ".join(filter(None, MODELS))
        raise ConfigError(
            f"lens model '{model}' is not one that rigcal has (known: {known}): calibrate the lens "
            "with one of these"
        )
    if K[0, 1] != 0:
        raise ConfigError(
            f"the camera matrix has a skew of {K[0, 1]:g}, which no lens model takes: calibrate "
            "the lens without skew"
        )
    return fields | {
        "model": MODELS[model],
        "focal_px": [float(K[0, 0]), float(K[1, 1])],
        "principal_px": [float(K[0, 2]), float(K[1, 2])],
        "distortion": [float(number) for number in distortion],
    }
