"""Lens models: pixels from points and back, vectorised, with analytic Jacobians.

`pinhole` is OpenCV's model with k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tau_x tau_y]]]], `fisheye`
is Kannala & Brandt 2006 as in `cv2.fisheye`. Pixel (0, 0) is the centre of the top-left pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry.se3 import Array
from rigcal_camera.config import CameraConfig

_MIN_DEPTH_M = 1e-6
_NEWTON_STEPS = 8


@dataclass(frozen=True)
class Lens:
    """The intrinsics of one camera."""

    model: str
    focal: tuple[float, float]
    principal: tuple[float, float]
    distortion: tuple[float, ...]
    width: int
    height: int

    def pixels_from_points(self, p_s: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Projects (N, 3) points of the camera's frame.

        Returns uv (N, 2), its derivative by the point (N, 2, 3) [px/m], and which points can be
        imaged at all (N,); where not, uv and derivative are zero.
        """
        p_s = np.asarray(p_s, dtype=np.float64)
        project = self._project_fisheye if self.model == "fisheye" else self._project_pinhole
        with np.errstate(all="ignore"):
            xy, J, valid = project(p_s)
        focal = np.array(self.focal)
        uv = np.where(valid[:, None], xy * focal + self.principal, 0.0)
        return uv, np.where(valid[:, None, None], J * focal[:, None], 0.0), valid

    def sees(self, p_s: Array) -> NDArray[np.bool_]:
        """Which of (N, 3) points fall into the image, within the lens model's one-to-one range."""
        p_s = np.asarray(p_s, dtype=np.float64)
        uv, _, valid = self.pixels_from_points(p_s)
        angle = np.arctan2(np.hypot(p_s[:, 0], p_s[:, 1]), p_s[:, 2])
        inside = (uv > -0.5) & (uv < np.array([self.width, self.height]) - 0.5)
        result: NDArray[np.bool_] = valid & (angle <= self.max_angle) & inside.all(axis=1)
        return result

    def rays_from_pixels(self, uv: Array) -> Array:
        """Unit directions (N, 3) in the camera's frame of pixels (N, 2).

        The inverse of `pixels_from_points` by Newton's method from a table of the radial part; NaN
        for pixels that no ray of the model's one-to-one range reaches.
        """
        xy = (np.asarray(uv, dtype=np.float64) - self.principal) / self.focal
        with np.errstate(all="ignore"):
            rays = self._rays_fisheye(xy) if self.model == "fisheye" else self._rays_pinhole(xy)
            result: Array = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        return result

    @property
    def max_angle(self) -> float:
        """Angle from the axis (rad) up to which the model is one-to-one."""
        return float(self._radial_table[0][-1])

    @cached_property
    def _radial_table(self) -> tuple[Array, Array]:
        """Angles from the axis and their distorted radius, as far as the radius grows."""
        limit = np.radians(179.5 if self.model == "fisheye" else 89.5)
        angle = np.linspace(0.0, limit, 4001)
        with np.errstate(all="ignore"):
            if self.model == "fisheye":
                radius = self._fisheye_radius(angle)[0]
            else:
                r = np.tan(angle)
                radius = r * self._radial_factor(r**2)[0]
        stops = np.flatnonzero(~(np.diff(radius) > 0))
        end = (stops[0] if len(stops) else len(angle) - 1) + 1
        return angle[:end], radius[:end]

    def _coefficients(self) -> tuple[float, ...]:
        return self.distortion + (0.0,) * (14 - len(self.distortion))

    def _radial_factor(self, r2: Array) -> tuple[Array, Array]:
        """The radial factor of the pinhole model and its derivative by r^2."""
        k1, k2, _, _, k3, k4, k5, k6 = self._coefficients()[:8]
        numerator = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        denominator = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
        factor = numerator / denominator
        slope = k1 + r2 * (2 * k2 + r2 * 3 * k3) - factor * (k4 + r2 * (2 * k5 + r2 * 3 * k6))
        return factor, slope / denominator

    def _distort(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Radial, tangential and thin-prism distortion: (N, 2) and its Jacobian (N, 2, 2)."""
        _, _, p1, p2, _, _, _, _, s1, s2, s3, s4, _, _ = self._coefficients()
        r2 = x**2 + y**2
        g, dg = self._radial_factor(r2)
        xd = x * g + 2 * p1 * x * y + p2 * (r2 + 2 * x**2) + r2 * (s1 + s2 * r2)
        yd = y * g + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y + r2 * (s3 + s4 * r2)
        prism_x, prism_y = 2 * (s1 + 2 * s2 * r2), 2 * (s3 + 2 * s4 * r2)
        mixed = 2 * x * y * dg + 2 * p1 * x + 2 * p2 * y
        J = np.empty((len(x), 2, 2))
        J[:, 0, 0] = g + 2 * x**2 * dg + 2 * p1 * y + 6 * p2 * x + prism_x * x
        J[:, 0, 1] = mixed + prism_x * y
        J[:, 1, 0] = mixed + prism_y * x
        J[:, 1, 1] = g + 2 * y**2 * dg + 6 * p1 * y + 2 * p2 * x + prism_y * y
        return np.column_stack([xd, yd]), J

    @cached_property
    def _tilt(self) -> Array | None:
        """The homography (3, 3) of a tilted sensor (Scheimpflug), None without tilt."""
        tau_x, tau_y = self._coefficients()[12:]
        if tau_x == 0 and tau_y == 0:
            return None
        cx, sx, cy, sy = np.cos(tau_x), np.sin(tau_x), np.cos(tau_y), np.sin(tau_y)
        R = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]]) @ np.array(
            [[1, 0, 0], [0, cx, sx], [0, -sx, cx]]
        )
        result: Array = np.array([[R[2, 2], 0, -R[0, 2]], [0, R[2, 2], -R[1, 2]], [0, 0, 1]]) @ R
        return result

    def _project_pinhole(self, p: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        valid = p[:, 2] > _MIN_DEPTH_M
        inverse_z = 1 / np.where(valid, p[:, 2], 1.0)
        x, y = p[:, 0] * inverse_z, p[:, 1] * inverse_z
        xy, J = self._distort(x, y)
        if self._tilt is not None:
            h = np.column_stack([xy, np.ones(len(xy))]) @ self._tilt.T
            tilted = h[:, :2] / h[:, 2:]
            outer = tilted[:, :, None] * self._tilt[2, :2]
            J = ((self._tilt[:2, :2] - outer) / h[:, 2, None, None]) @ J
            xy = tilted
        # By the point: J [I, -(x, y)] / z.
        outer = -(J[..., 0] * x[:, None] + J[..., 1] * y[:, None])
        J_point = np.concatenate([J, outer[..., None]], axis=2) * inverse_z[:, None, None]
        return xy, J_point, valid & np.isfinite(xy).all(axis=1)

    def _rays_pinhole(self, xy: Array) -> Array:
        if self._tilt is not None:
            h = np.column_stack([xy, np.ones(len(xy))]) @ np.linalg.inv(self._tilt).T
            xy = h[:, :2] / h[:, 2:]
        if not any(self.distortion):
            return np.column_stack([xy, np.ones(len(xy))])
        angles, radii = self._radial_table
        radius = np.hypot(xy[:, 0], xy[:, 1])
        guess = np.tan(np.interp(radius, radii, angles))
        solution = xy * (guess / np.where(radius > 0, radius, 1.0))[:, None]
        for _ in range(_NEWTON_STEPS):
            distorted, J = self._distort(solution[:, 0], solution[:, 1])
            error = xy - distorted
            determinant = J[:, 0, 0] * J[:, 1, 1] - J[:, 0, 1] * J[:, 1, 0]
            dx = (J[:, 1, 1] * error[:, 0] - J[:, 0, 1] * error[:, 1]) / determinant
            dy = (J[:, 0, 0] * error[:, 1] - J[:, 1, 0] * error[:, 0]) / determinant
            solution = solution + np.column_stack([dx, dy])
            if not (np.abs(dx) + np.abs(dy) > 1e-12).any():
                break
        error = xy - self._distort(solution[:, 0], solution[:, 1])[0]
        reached = np.abs(error).max(axis=1) < 1e-9
        reached &= np.hypot(solution[:, 0], solution[:, 1]) <= np.tan(self.max_angle)
        solution[~reached] = np.nan
        return np.column_stack([solution, np.ones(len(xy))])

    def _fisheye_radius(self, angle: Array) -> tuple[Array, Array]:
        """Distorted radius of an angle from the axis, and its derivative."""
        k1, k2, k3, k4 = (*self.distortion, 0.0, 0.0, 0.0, 0.0)[:4]
        a2 = angle**2
        radius = angle * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4))))
        slope = 1 + a2 * (3 * k1 + a2 * (5 * k2 + a2 * (7 * k3 + a2 * 9 * k4)))
        return radius, slope

    def _project_fisheye(self, p: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        x, y, z = p.T
        r, square = np.hypot(x, y), np.einsum("ij,ij->i", p, p)
        angle = np.arctan2(r, z)
        valid = (angle <= max(self.max_angle, np.pi / 2)) & (square > _MIN_DEPTH_M**2)
        radius, slope = self._fisheye_radius(angle)
        off_axis = r > 1e-9
        scale = np.where(off_axis, radius / np.where(off_axis, r, 1.0), 1 / z)
        bend = np.where(off_axis, (slope * z / square - scale) / np.where(off_axis, r, 1) ** 2, 0)
        J = np.empty((len(p), 2, 3))
        J[:, 0, 0], J[:, 1, 1] = scale + x**2 * bend, scale + y**2 * bend
        J[:, 0, 1] = J[:, 1, 0] = x * y * bend
        J[:, 0, 2], J[:, 1, 2] = -x * slope / square, -y * slope / square
        return p[:, :2] * scale[:, None], J, valid

    def _rays_fisheye(self, xy: Array) -> Array:
        angles, radii = self._radial_table
        radius = np.hypot(xy[:, 0], xy[:, 1])
        angle = np.interp(radius, radii, angles)
        for _ in range(_NEWTON_STEPS):
            distorted, slope = self._fisheye_radius(angle)
            angle = angle + (radius - distorted) / slope
        angle = np.where(radius <= radii[-1], angle, np.nan)
        direction = xy / np.where(radius > 0, radius, 1.0)[:, None]
        return np.column_stack([direction * np.sin(angle)[:, None], np.cos(angle)])


@lru_cache(maxsize=64)
def _lens(*intrinsics: object) -> Lens:
    return Lens(*intrinsics)  # type: ignore[arg-type]


def lens_of(config: CameraConfig) -> Lens:
    """The lens of a camera; equal intrinsics share one object and its caches."""
    return _lens(
        config.model,
        config.focal_px,
        config.principal_px,
        config.distortion,
        config.width_px,
        config.height_px,
    )
