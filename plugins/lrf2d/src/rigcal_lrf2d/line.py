"""Maximum-likelihood lines through beams of a 2D scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rigcal.geometry.se3 import Array
from rigcal.ranging import RangeNoise

MIN_INCIDENCE = 0.05
"""Least |n . u| of a beam that says anything about a line: grazing by 3 degrees."""


@dataclass(frozen=True, eq=False)
class Line:
    """`normal . p + d = 0` in the scan plane, d > 0: the unit normal (2,) points to the sensor.

    Or S lines at once: normal (S, 2), d (S,); what is (N,) below is then (S, N).
    """

    normal: Array
    d: Array

    @property
    def direction(self) -> Array:
        """(2,) unit vector along the line, in the sense of growing beam angles."""
        return np.stack([self.normal[..., 1], -self.normal[..., 0]], axis=-1)

    def incidence(self, u: Array) -> Array:
        """(N,) `normal . u` for unit directions (N, 2); negative where a beam meets the line."""
        result: Array = (u @ self.normal[..., None])[..., 0]
        return result

    def range_of(self, u: Array) -> Array:
        """(N,) range at which beams (N, 2) meet the line (eq. 4.12 of the seed); inf if never."""
        dot = self.incidence(u)
        meets = dot < -MIN_INCIDENCE
        return np.where(meets, -self.d[..., None] / np.where(meets, dot, -1.0), np.inf)

    def sigma(self, u: Array, noise: RangeNoise) -> Array:
        """(N,) standard deviation of the range at which each beam meets the line."""
        dot = np.minimum(self.incidence(u), -MIN_INCIDENCE)
        return noise.on_plane(-self.d[..., None] / dot, dot)

    def whitened(self, u: Array, r: Array, noise: RangeNoise) -> Array:
        """(N,) (measured - predicted range) / sigma; -inf where a beam never meets the line."""
        result: Array = (r - self.range_of(u)) / self.sigma(u, noise)
        return result


def moments(points: Array) -> Array:
    """(N, 6) of points (N, 2): 1, x, y, x^2, x y, y^2. Sums of rows give the line of a subset."""
    x, y = points.T
    return np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])


def line_of_moments(sums: ArrayLike) -> tuple[Line, Array, Array]:
    """Total-least-squares lines of summed moments (..., 6).

    And the sums of squares across (...) and along (...) each line, m^2.
    """
    count, x, y, xx, xy, yy = np.moveaxis(np.asarray(sums, np.float64), -1, 0)
    x, y = x / count, y / count
    xx, xy, yy = xx - count * x * x, xy - count * x * y, yy - count * y * y
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)
    normal = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    d = -(normal[..., 0] * x + normal[..., 1] * y)
    sign = np.where(d < 0, -1.0, 1.0)
    spread, mean = np.hypot((xx - yy) / 2, xy), (xx + yy) / 2
    return Line(normal * sign[..., None], d * sign), np.maximum(mean - spread, 0.0), mean + spread


def total_least_squares(points: Array) -> Line:
    """The line nearest to (N, 2) points."""
    return line_of_moments(moments(points).sum(axis=0))[0]


def _jacobian(line: Line, u: Array) -> tuple[Array, Array]:
    """Predicted ranges (N,) and their derivative (N, 2) by [angle of the normal, d]."""
    dot = line.incidence(u)
    return -line.d / dot, np.column_stack([-line.d * (u @ line.direction) / dot**2, -1 / dot])


def fit_line(u: Array, r: Array, noise: RangeNoise, steps: int = 3) -> Line | None:
    """The line that minimises the whitened range residuals of beams u (N, 2) with ranges r (N,).

    Gauss-Newton from the total-least-squares line. None if the beams graze it.
    """
    line = total_least_squares(u * r[:, None])
    for _ in range(steps):
        if float(line.incidence(u).max()) > -MIN_INCIDENCE:
            return None
        predicted, J = _jacobian(line, u)
        weighted = J / line.sigma(u, noise)[:, None] ** 2
        A, b = weighted.T @ J, weighted.T @ (r - predicted)
        if np.linalg.det(A) <= 1e-12 * A[0, 0] * A[1, 1]:
            return None
        turn, shift = np.linalg.solve(A, b)
        c, s = np.cos(turn), np.sin(turn)
        line = Line(np.array([[c, -s], [s, c]]) @ line.normal, line.d + shift)
        if line.d <= 0 or abs(turn) > 0.5:
            return None
    return line if float(line.incidence(u).max()) < -MIN_INCIDENCE else None


def line_covariance(line: Line, u: Array, noise: RangeNoise) -> Array:
    """(2, 2) covariance of a line fitted to beams u, over [angle of the normal (rad), d (m)]."""
    _, J = _jacobian(line, u)
    whitened = J / line.sigma(u, noise)[:, None]
    information: Array = whitened.T @ whitened
    result: Array = np.asarray(np.linalg.inv(information), np.float64)
    return result
