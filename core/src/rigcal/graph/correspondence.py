"""What two sensors say about the board in the exposures they share, as flat arrays.

A correspondence is one candidate of each sensor in one exposure. Whatever the geometries, it is
measured in metres: known points of the board seen from b, against the plane (or the points) that
a sees there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import tangent_basis
from rigcal.observation import (
    Geometry,
    LineGeometry,
    Observation,
    PlaneGeometry,
    PointGeometry,
    PoseGeometry,
)
from rigcal.targets.target import Target

MODEL_ERROR_M = 0.02
"""Allowance for what the sensors' noise leaves out: biased ranges, bent boards, lens models."""


@dataclass(frozen=True, eq=False)
class Correspondences:
    """H correspondences, sorted by exposure.

    exposure (H,), a (H,), b (H,): indices of the exposure and of the candidates. Points of the
    board in b: p_b (H, m, 3), which lie on the plane n_a (H, 3), d_a (H,) or are the points
    p_a (H, m, 3). center_a, center_b (H, 3): where on the board each sensor looked. sigma (H,):
    standard deviation of the distances, m. reach (H,): how far apart the centres may be, m.
    """

    exposure: NDArray[np.int64]
    a: NDArray[np.int64]
    b: NDArray[np.int64]
    p_b: Array
    n_a: Array
    d_a: Array
    p_a: Array
    center_a: Array
    center_b: Array
    sigma: Array
    reach: Array
    on_points: bool

    def distances(self, T_a_b: Array) -> tuple[Array, Array]:
        """Rms distances (M, H) in m under (M, 4, 4) transforms, and distances of the centres."""
        R, t = T_a_b[:, None, :3, :3], T_a_b[:, None, None, :3, 3]
        p = self.p_b @ np.swapaxes(R, -1, -2) + t
        if self.on_points:
            squares = np.sum((p - self.p_a) ** 2, axis=-1)
        else:
            squares = (np.einsum("mhki,hi->mhk", p, self.n_a) + self.d_a[:, None]) ** 2
        center = np.einsum("mij,hj->mhi", T_a_b[:, :3, :3], self.center_b) + T_a_b[:, None, :3, 3]
        apart = np.linalg.norm(center - self.center_a, axis=-1)
        return np.sqrt(squares.mean(axis=-1)), apart

    def rows(self, T_a_b: Array, keep: NDArray[np.intp]) -> tuple[Array, Array]:
        """Whitened residuals (n,) and Jacobians (n, 6), right perturbation, of correspondences."""
        R = T_a_b[:3, :3]
        p_b = self.p_b[keep]
        p = se3.apply(T_a_b, p_b)
        J = np.concatenate([-R @ se3.skew(p_b), np.broadcast_to(R, (*p_b.shape[:-1], 3, 3))], -1)
        if self.on_points:
            e = p - self.p_a[keep]
        else:
            n = self.n_a[keep]
            e = np.einsum("hki,hi->hk", p, n) + self.d_a[keep, None]
            J = np.einsum("hi,hkij->hkj", n, J)
        s = self.sigma[keep].reshape(-1, *[1] * (e.ndim - 1))
        return (e / s).reshape(-1), (J / s[..., None]).reshape(-1, 6)


def determines(a: Geometry, b: Geometry) -> bool:
    """Whether observations a, b (in this order) fix a transform: b's points on what a sees."""
    match a, b:
        case PoseGeometry() | PointGeometry(), PoseGeometry() | PointGeometry():
            return True
        case PoseGeometry() | PlaneGeometry(), PlaneGeometry() | LineGeometry():
            return True
    return False


def correspondences(
    pairs: Sequence[tuple[Observation, Observation]], target: Target
) -> Correspondences | None:
    """All candidate pairs of the exposures that a and b share; None if no pair determines."""
    indices, rows = [], []
    for k, (first, second) in enumerate(pairs):
        for i, ca in enumerate(first.candidates):
            for j, cb in enumerate(second.candidates):
                if determines(ca.geometry, cb.geometry):
                    indices.append((k, i, j))
                    rows.append(_row(ca.geometry, cb.geometry, target))
    if not rows:
        return None
    exposure, a, b = np.array(indices).T
    p_b, n_a, d_a, p_a, center_a, center_b, sigma, reach = (
        np.array(column) for column in zip(*rows, strict=True)
    )
    seen_from_b = pairs[exposure[0]][1].candidates[b[0]].geometry
    on_points = not isinstance(seen_from_b, PlaneGeometry | LineGeometry)
    return Correspondences(
        exposure, a, b, p_b, n_a, d_a, p_a, center_a, center_b, sigma, reach, on_points
    )


def _row(a: Geometry, b: Geometry, target: Target) -> tuple[Array, ...]:
    """p_b, n_a, d_a, p_a, center_a, center_b, sigma, reach of one correspondence."""
    half = 0.35 * float(np.hypot(*target.size)) / np.sqrt(2)
    n, d = np.zeros(3), 0.0
    if isinstance(b, PlaneGeometry | LineGeometry):
        n, d = plane_of(a)
        p_b = board_points(b, half)
        p_a = np.zeros_like(p_b)
    else:
        p_t = _common_points(a, b, target)
        p_a, p_b = _points_of(a, p_t), _points_of(b, p_t)
    noise = np.sqrt(_variance(a, half) + _variance(b, half) + MODEL_ERROR_M**2)
    diagonal = float(np.hypot(*target.size))
    # A line or a hand-covered plane may lie anywhere on the board.
    reach = (0.55 if isinstance(a, PoseGeometry) else 0.8) * diagonal + 3 * noise
    columns = p_b, n, d, p_a, center_of(a), center_of(b), noise, reach
    return tuple(np.asarray(c, dtype=np.float64) for c in columns)


def plane_of(g: Geometry) -> tuple[Array, float]:
    """Normal towards the sensor's side and distance of the target's plane, from pose or plane."""
    if isinstance(g, PoseGeometry):
        n = g.T_s_t[:3, 2]
        return n, -float(n @ g.T_s_t[:3, 3])
    assert isinstance(g, PlaneGeometry)
    return g.normal, g.d


def center_of(g: Geometry) -> Array:
    """(3,) where on the target the sensor looked."""
    match g:
        case PoseGeometry():
            center: Array = g.T_s_t[:3, 3]
            return center
        case PlaneGeometry():
            return g.center
        case LineGeometry():
            return (g.start + g.end) / 2
        case PointGeometry():
            return g.position


def board_points(g: PlaneGeometry | LineGeometry, half: float) -> Array:
    """(m, 3) points that stand for the observation: a plane's tilt acts on the board's extent."""
    if isinstance(g, LineGeometry):
        return np.stack([g.start, g.end])
    B = tangent_basis(g.normal) * half
    return g.center + np.stack([B[:, 0], B[:, 1], -B[:, 0], -B[:, 1]])


def _common_points(a: Geometry, b: Geometry, target: Target) -> Array:
    for g in (a, b):
        if isinstance(g, PointGeometry):
            return g.target_point[None]
    return target.outline_points


def _points_of(g: Geometry, p_t: Array) -> Array:
    return g.position[None] if isinstance(g, PointGeometry) else se3.apply(_pose(g), p_t)


def _pose(g: Geometry) -> Array:
    assert isinstance(g, PoseGeometry)
    return g.T_s_t


def _variance(g: Geometry, half: float) -> float:
    """Mean variance (m^2) of the board's points as this observation places them."""
    match g:
        case PoseGeometry():
            c = np.diagonal(g.covariance)
            return float(c[:3].mean() * 2 * half**2 + c[3:].mean())
        case PlaneGeometry():
            c = np.diagonal(g.covariance)
            return float(c[:2].mean() * half**2 + c[2])
        case LineGeometry():
            return float(np.trace(g.covariance)) / 6
        case PointGeometry():
            return float(np.trace(g.covariance)) / 3
