"""A second look at an image, where the target must be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.observation import Candidate, Detection, PoseGeometry
from rigcal.targets.target import Target
from rigcal_camera.config import CameraConfig
from rigcal_camera.detector import explain, find_corners
from rigcal_camera.frames import Image
from rigcal_camera.lens import lens_of

_ENLARGED = 2
_MARGIN = 0.15
_MOST_PX = 1500
_LEAST_PX = 16
_CONTRAST = 2.0
_NEAR = 0.25
"""How far (of the target's diagonal) its corners may be from where they were predicted."""


def near(image: Image, config: CameraConfig, target: Target, T_s_t: Array) -> Detection:
    """What the detector finds in the predicted part of the image, enlarged and with more contrast.

    Only poses near the predicted one: the corners of the target within a quarter of its diagonal.
    """
    import cv2

    box = _predicted_box(image, config, target, T_s_t)
    if box is None:
        return Detection((), "the target is out of the image where it must be")
    left, top, right, bottom = box
    scale = _ENLARGED if max(right - left, bottom - top) * _ENLARGED <= _MOST_PX else 1
    part = np.ascontiguousarray(image[top:bottom, left:right])
    enlarged = cv2.resize(part, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    clear = np.asarray(cv2.createCLAHE(_CONTRAST, (8, 8)).apply(enlarged), np.uint8)
    part_lens = lens_of(_part_of(config, (left, top), scale, clear.shape))
    corners = find_corners(clear, target, part_lens)
    uv = (corners.uv + 0.5) / scale - 0.5 + np.array((left, top))
    # Contrast that differs from place to place moves corners: the image itself has the last word.
    found = explain(replace(corners, uv=uv), config, target, image)
    close = tuple(c for c in found.candidates if _is_near(c, target, T_s_t))
    if found.candidates and not close:
        return Detection((), "what looks like the target is not where it must be")
    return Detection(close, found.reason)


def _predicted_box(
    image: Image, config: CameraConfig, target: Target, T_s_t: Array
) -> tuple[int, int, int, int] | None:
    """Left, top, right, bottom (exclusive) of the target's pixels with a margin; None if too few"""
    lens = lens_of(config)
    p_s = se3.apply(T_s_t, np.concatenate([target.outline_points, target.points]))
    seen = p_s[lens.sees(p_s)]
    if not len(seen):
        return None
    uv = lens.pixels_from_points(seen)[0]
    low, high = uv.min(axis=0), uv.max(axis=0)
    margin = _MARGIN * float((high - low).max())
    low = np.maximum(np.floor(low - margin), 0).astype(int)
    high = np.minimum(np.ceil(high + margin) + 1, image.shape[::-1]).astype(int)
    if (high - low).min() < _LEAST_PX:
        return None
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def _part_of(
    config: CameraConfig, corner: tuple[int, int], scale: int, shape: tuple[int, ...]
) -> CameraConfig:
    """The camera of a part of the image that begins at pixel `corner`, enlarged.

    Pixel (0, 0) is a centre: u' = scale (u - left + 1/2) - 1/2.
    """
    principal = tuple(
        scale * (c - first + 0.5) - 0.5
        for c, first in zip(config.principal_px, corner, strict=True)
    )
    focal = tuple(scale * f for f in config.focal_px)
    size = {"width_px": shape[1], "height_px": shape[0]}
    return config.model_copy(update={**size, "focal_px": focal, "principal_px": principal})


def _is_near(candidate: Candidate, target: Target, T_s_t: Array) -> bool:
    assert isinstance(candidate.geometry, PoseGeometry)
    corners = target.outline_points
    apart = se3.apply(candidate.geometry.T_s_t, corners) - se3.apply(T_s_t, corners)
    diagonal = float(np.hypot(*target.size))
    return bool(np.linalg.norm(apart, axis=1).max() < _NEAR * diagonal)
