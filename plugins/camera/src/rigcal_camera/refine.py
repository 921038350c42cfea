"""The lens as numbers that the data may refine: focal lengths, principal point, distortion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry.se3 import Array
from rigcal.plugin import Parameters, Refinable
from rigcal_camera.config import CameraConfig
from rigcal_camera.lens import Lens, lens_of

_PINHOLE = (
    "k1",
    "k2",
    "p1",
    "p2",
    "k3",
    "k4",
    "k5",
    "k6",
    "s1",
    "s2",
    "s3",
    "s4",
    "tau_x",
    "tau_y",
)
_FISHEYE = ("k1", "k2", "k3", "k4")
_TOLERABLE = 0.01
"""Of the image's width: a lens from a data sheet is as good as that."""
_GRID = (9, 7)


def lens_values(lens: Lens) -> Array:
    """(P,) fx, fy, cx, cy and the distortion."""
    return np.array([*lens.focal, *lens.principal, *lens.distortion])


def with_values(lens: Lens, values: Array) -> Lens:
    """The lens with other numbers (P,)."""
    fx, fy, cx, cy, *distortion = values.tolist()
    return replace(lens, focal=(fx, fy), principal=(cx, cy), distortion=tuple(distortion))


def pixels_by_lens(lens: Lens, p_s: Array, valid: NDArray[np.bool_]) -> Array:
    """(N, 2, P) derivative of the pixels of points (N, 3) by the lens; 0 where not `valid` (N,)."""
    import cv2

    K = np.array([[lens.focal[0], 0, lens.principal[0]], [0, lens.focal[1], lens.principal[1]]])
    K, none = np.vstack([K, [0.0, 0.0, 1.0]]), np.zeros(3)
    count = 4 + len(lens.distortion)
    result = np.zeros((len(p_s), 2, count))
    if not valid.any():
        return result
    points = np.ascontiguousarray(p_s[valid]).reshape(-1, 1, 3)
    D = np.array(lens.distortion or (0.0,) * 4)
    if lens.model == "fisheye":
        J = cv2.fisheye.projectPoints(points, none, none, K, D)[1]
    else:
        # Before the lens come three columns of rotation and three of translation.
        J = cv2.projectPoints(points, none, none, K, D)[1][:, 6:]
    result[valid] = J[:, :count].reshape(-1, 2, count)
    return result


def lens_parameters(config: CameraConfig) -> Parameters:
    """The lens of a camera as its config gives it; a pixel anywhere in the image may be off 1 %."""
    lens = lens_of(config)
    across, down = (
        np.linspace(0, n - 1, k) for n, k in zip((lens.width, lens.height), _GRID, strict=True)
    )
    rays = lens.rays_from_pixels(np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2))
    rays = rays[np.isfinite(rays).all(axis=1)]
    J = pixels_by_lens(lens, rays, lens.pixels_from_points(rays)[2])
    values = lens_values(lens)
    names = _FISHEYE if lens.model == "fisheye" else _PINHOLE
    return Parameters(
        names=("fx", "fy", "cx", "cy", *names[: len(lens.distortion)]),
        units=("px",) * 4 + ("",) * len(lens.distortion),
        values=values,
        effect=J.reshape(-1, len(values)) / (_TOLERABLE * lens.width),
        tolerable=f"{100 * _TOLERABLE:g} % of the image's width somewhere in the image",
        advice="show the board tilted, near and far, in all parts of the image up to its corners; "
        "or give fewer numbers of distortion",
    )


def _apply(config: CameraConfig, values: Array) -> CameraConfig:
    lens = with_values(lens_of(config), values)
    intrinsics = {
        "focal_px": lens.focal, "principal_px": lens.principal, "distortion": lens.distortion
    }  # fmt: skip
    return config.model_copy(update=intrinsics)


LENS = Refinable(lens_parameters, _apply)
