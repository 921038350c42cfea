"""A board that is bent: its face lies at `z = (k_x x^2 + k_y y^2) / 2 + k_xy x y`.

`bend` (3,) is [k_x, k_y, k_xy], curvatures in 1/m; x, y and z are in the target's frame.
"""

from __future__ import annotations

import numpy as np

from rigcal.geometry.se3 import Array

_STEPS = 6


def height_by_bend(points: Array) -> Array:
    """(..., 3) derivative of the height z by the bend, at the x and y of points (..., 2 or 3)."""
    x, y = points[..., 0], points[..., 1]
    result: Array = np.stack([x * x / 2, y * y / 2, x * y], axis=-1)
    return result


def onto_bend(points: Array, bend: Array) -> Array:
    """(..., 3) points with the same x and y, on the bent face."""
    return np.concatenate([points[..., :2], (height_by_bend(points) @ bend)[..., None]], axis=-1)


def range_to_bend(origins: Array, directions: Array, bend: Array) -> Array:
    """(N,) ranges at which rays in the target's frame meet the bent face; infinite for none.

    origins (3,) or (N, 3), unit directions (N, 3). Newton's method, from the plane z = 0.
    """
    k_x, k_y, k_xy = bend
    C = np.array([[k_x, k_xy], [k_xy, k_y]])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        t = -origins[..., 2] / directions[:, 2]
        for _ in range(_STEPS):
            p = origins + t[:, None] * directions
            slope = directions[:, 2] - np.einsum("ni,ij,nj->n", p[:, :2], C, directions[:, :2])
            t = t - (p[:, 2] - height_by_bend(p) @ bend) / slope
    result: Array = np.where(np.isfinite(t), t, np.inf)
    return result
