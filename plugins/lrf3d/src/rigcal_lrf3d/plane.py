"""The most likely plane of laser returns, from the errors of their ranges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import fit_plane, tangent_basis
from rigcal.ranging import RangeNoise

_TRIM = 3.5
"""Returns farther from the plane than this many sigmas are no part of the board."""

_CELL_BIAS = 1.2
"""How far (in sigmas) the mean error on a small part of the board may lie off."""

_GRAZING = 0.05
"""Beams whose cosine of incidence is smaller tell nothing of a plane."""

_MAX_SCALE = 2.5
"""How far the trimming may widen when the returns are noisier than the rig file says."""


@dataclass(frozen=True, eq=False)
class Plane:
    """`n . p + d = 0` with d >= 0, its covariance (see `rigcal.observation.PlaneGeometry`) about
    `center` (3,), the points that gave it, and their rms error in sigmas.
    """

    normal: Array
    d: float
    center: Array
    covariance: Array
    inliers: NDArray[np.bool_]
    rms: float


def beams(points: Array) -> tuple[Array, Array]:
    """Ranges (N,) and unit directions (N, 3) from the sensor's origin to points (N, 3)."""
    ranges = np.linalg.norm(points, axis=1)
    return ranges, points / ranges[:, None]


def range_errors(points: Array, n: Array, d: float) -> tuple[Array, Array]:
    """Measured minus expected range (N,) of beams from the origin, and `n . rho` (N,).

    The expected range is `t = -d / (n . rho)` (MSG-Cal, eq. 4.12 with p0 = 0).
    """
    ranges, directions = beams(points)
    cosine = directions @ n
    cosine = np.where(np.abs(cosine) < 1e-6, -1e-6, cosine)
    return ranges + d / cosine, cosine


def sigma_on(points: Array, n: Array, d: float, noise: RangeNoise) -> Array:
    """(N,) noise (m) of the ranges at which the beams to points (N, 3) meet a plane.

    At the expected range: the noise of the measured one would favour returns that are too near.
    """
    error, cosine = range_errors(points, n, d)
    return noise.on_plane(np.abs(np.linalg.norm(points, axis=1) - error), cosine)


def beam_feet(points: Array, n: Array, d: float) -> Array:
    """(N, 3) where the beams from the origin to points (N, 3) meet a plane.

    To choose points by their beams, and not by themselves, keeps the choice free of their noise.
    """
    error, _ = range_errors(points, n, d)
    return points - error[:, None] * beams(points)[1]


def fit(points: Array, n: Array, d: float, noise: RangeNoise, cell: float) -> Plane | None:
    """The plane of points (N, 3) by maximum likelihood, starting from `n . p + d = 0`.

    Gauss-Newton on the range errors over [tilt about the two columns of `tangent_basis(n)`, offset
    along n at the centre]; after each step the returns beyond 3.5 sigma (mixed pixels at edges,
    hands) are dropped and those within taken back; so are all of a square of `cell` (m) whose mean
    is off (a finger is too near for a single return to tell). None if too few returns remain.
    """
    steep = np.abs(range_errors(points, n, d)[1]) > _GRAZING
    ranges = np.linalg.norm(points, axis=1)
    inliers = steep & (np.abs(points @ n + d) < 2 * _TRIM * noise.of(ranges))
    for _ in range(8):
        if inliers.sum() < 6:
            return None
        n, d, center, covariance, rms = _step(points[inliers], n, d, noise)
        error, cosine = range_errors(points, n, d)
        whitened = error / sigma_on(points, n, d, noise)
        scale = np.clip(1.4826 * np.median(np.abs(whitened[inliers])), 1.0, _MAX_SCALE)
        previous, near = inliers, (np.abs(whitened) < _TRIM * scale) & (np.abs(cosine) > _GRAZING)
        inliers = near.copy()
        inliers[near] = _in_good_cells(
            beam_feet(points[near], n, d), n, whitened[near] / scale, cell
        )
        if np.array_equal(previous, inliers):
            break
    if inliers.sum() < 6:
        return None
    for _ in range(2):
        n, d, center, covariance, rms = _step(points[inliers], n, d, noise)
    return Plane(n, d, center, covariance, inliers, rms)


def _step(
    points: Array, n: Array, d: float, noise: RangeNoise
) -> tuple[Array, float, Array, Array, float]:
    """One Gauss-Newton step: n, d, center, covariance, rms of the whitened errors before it.

    The derivative of a range error by the plane is `[q; 1] / (n . rho)`, q where the beam meets
    the plane.
    """
    error, cosine = range_errors(points, n, d)
    sigma = sigma_on(points, n, d, noise)
    q = points - error[:, None] * beams(points)[1]
    center = points.mean(axis=0)
    center = center - (n @ center + d) * n
    basis = tangent_basis(n)
    tilt = np.cross(basis.T, n)  # n changes by a x n, and d so that the plane turns about center
    J = np.column_stack([(q - center) @ tilt.T, -np.ones(len(q))]) / (cosine * sigma)[:, None]
    information = J.T @ J
    covariance = np.linalg.inv(information + 1e-9 * np.trace(information) * np.eye(3))
    a1, a2, offset = -covariance @ (J.T @ (error / sigma))
    n_new = n + a1 * tilt[0] + a2 * tilt[1]
    n_new /= np.linalg.norm(n_new)
    center = center + offset * n
    d_new = -float(n_new @ center)
    if d_new < 0:
        n_new, d_new = -n_new, -d_new
    return n_new, d_new, center, covariance, float(np.sqrt(np.mean((error / sigma) ** 2)))


def _in_good_cells(feet: Array, n: Array, whitened: Array, cell: float) -> NDArray[np.bool_]:
    """Which beams, by their feet (N, 3), lie in squares whose mean error is that of a board.

    A mean of k errors is off beyond `_CELL_BIAS + 3.5 / sqrt(k)` sigmas: the first part is what
    rings of a multi-beam laser differ by.
    """
    squares = np.floor(feet @ tangent_basis(n) / cell)
    _, index, count = np.unique(squares, axis=0, return_inverse=True, return_counts=True)
    mean = np.bincount(index, whitened, minlength=len(count)) / count
    good: NDArray[np.bool_] = np.abs(mean) < _CELL_BIAS + _TRIM / np.sqrt(count)
    return good[index]


def coarse(points: Array, thickness: float) -> tuple[Array, float]:
    """Total-least-squares plane of points (M, 3), without those farther off than `thickness`."""
    n, d = fit_plane(points)
    for _ in range(5):
        near = np.abs(points @ n + d) < thickness
        if near.all() or near.sum() < 6:
            break
        n, d = fit_plane(points[near])
    return n, d
