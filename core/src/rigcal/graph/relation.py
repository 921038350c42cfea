"""What two sensors that see one board say about the transform between them.

A relation holds H correspondences as flat arrays, and measures them in metres: points of the board
as b sees them against the plane, the points or the pose that a sees.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph import solvers
from rigcal.graph.plane_line import from_planes_and_lines

Index = NDArray[np.intp]


class Relation(Protocol):
    """The measurement of a pair of geometries: k rows per correspondence, in m."""

    @property
    def components(self) -> tuple[int, ...]:
        """(k,) which rows are alike: shifts, tilts. Sensors may disagree in one and not another."""

    @property
    def sigma(self) -> Array:
        """(H,) standard deviation of the distances, m, before a transform is known."""

    @property
    def minimal(self) -> int:
        """How many correspondences a minimal sample has."""

    def solve(self, sample: Index) -> Array:
        """(M, 4, 4) transforms `T_a_b` of minimal samples (S, minimal)."""

    def distances(self, T_a_b: Array) -> Array:
        """(M, H) rms distances under transforms (M, 4, 4), m."""

    def residuals(self, T_a_b: Array, keep: Index) -> tuple[Array, Array, Array]:
        """r (n, k) in m, Jacobians (n, k, 6) by a right perturbation, covariances (n, k, k)."""

    def noise_information(self, T_a_b: Array, keep: Index, W: Array) -> Array:
        """(6, 6): what `sum J^T W J` holds only because J is made of noisy data; W (n, k, k)."""


@dataclass(frozen=True, eq=False)
class Planes:
    """The board's plane as a sensor sees it: `normal . p + d = 0`, normals (H, 3), d (H,).

    `covariance` (H, 3, 3) over [tilt about the columns of `basis` (H, 3, 2), offset at `center`].
    """

    normal: Array
    d: Array
    center: Array
    basis: Array
    covariance: Array

    def __getitem__(self, h: Index) -> Planes:
        return Planes(self.normal[h], self.d[h], self.center[h], self.basis[h], self.covariance[h])

    def influence(self, p: Array) -> Array:
        """(H, m, 3): how [tilt, offset] changes the distance of points p (H, m, 3)."""
        lever = np.cross(self.normal[:, None], p - self.center[:, None]) @ self.basis
        return np.concatenate([lever, -np.ones((*p.shape[:-1], 1))], axis=-1)


@dataclass(frozen=True, eq=False)
class OnPlanes:
    """Points of the board seen from b, p_b (H, m, 3) with covariance (H, 3 m, 3 m), lie in the
    plane that a sees. `planes_b` are the planes that b saw, where it saw any; `near_a` (H, 3) is
    where a looked. e = n_a . (R p_b + t) + d_a, and r = rows e: the shift, and what a tilt does.
    """

    planes_a: Planes
    p_b: Array
    covariance_b: Array
    sigma: Array
    planes_b: Planes | None
    near_a: Array
    rows: Array
    components: tuple[int, ...]

    @property
    def minimal(self) -> int:
        """Three planes or lines; a single point gives one equation."""
        return 6 if self.p_b.shape[1] == 1 else 3

    def solve(self, sample: Index) -> Array:
        """By what b saw: planes, lines or points."""
        n_a, d_a = self.planes_a.normal[sample], self.planes_a.d[sample]
        if self.planes_b is not None:
            return solvers.from_planes(
                n_a, d_a, self.planes_b.normal[sample], self.planes_b.d[sample]
            )
        p = self.p_b[sample]
        if self.minimal == 6:
            return solvers.from_planes_and_points(n_a, d_a, p[:, :, 0], self.near_a[sample])
        v = p[:, :, 1] - p[:, :, 0]
        v /= np.linalg.norm(v, axis=-1, keepdims=True)
        return from_planes_and_lines(n_a, d_a, p[:, :, 0], v)

    def distances(self, T_a_b: Array) -> Array:
        """Rms over the points."""
        n = self.planes_a.normal
        n_b = np.swapaxes(n @ T_a_b[:, :3, :3], -1, -2)  # (M, 3, H)
        at_origin = T_a_b[:, :3, 3] @ n.T + self.planes_a.d
        p = np.moveaxis(self.p_b, 0, -1)  # (m, 3, H)
        squares = [
            (n_b[:, 0] * x + n_b[:, 1] * y + n_b[:, 2] * z + at_origin) ** 2 for x, y, z in p
        ]
        result: Array = np.sqrt(np.mean(squares, axis=0))
        return result

    def residuals(self, T_a_b: Array, keep: Index) -> tuple[Array, Array, Array]:
        """de = n_b . (w x p_b + v), n_b = R^T n_a."""
        planes, p_b = self.planes_a[keep], self.p_b[keep]
        n_b = planes.normal @ T_a_b[:3, :3]
        p_a = se3.apply(T_a_b, p_b)
        e = np.einsum("hki,hi->hk", p_a, planes.normal) + planes.d[:, None]
        each = np.broadcast_to(n_b[:, None], p_b.shape)
        J = np.concatenate([np.cross(p_b, each), each], axis=-1)
        count, m = p_b.shape[:2]
        C = self.covariance_b[keep].reshape(count, m, 3, m, 3)
        C_b = np.einsum("hkilj,hi,hj->hkl", C, n_b, n_b)
        g = planes.influence(p_a)
        C_ab = C_b + g @ planes.covariance @ np.swapaxes(g, -1, -2)
        return e @ self.rows.T, self.rows @ J, self.rows @ C_ab @ self.rows.T

    def noise_information(self, T_a_b: Array, keep: Index, W: Array) -> Array:
        """A tilt of n_a turns the equation's normal, noise in p_b its lever."""
        planes, p_b = self.planes_a[keep], self.p_b[keep]
        R = T_a_b[:3, :3]
        # u = w x p + v moves the point; the tilts see basis^T (n x R u).
        motion = np.concatenate(
            [-se3.skew(p_b), np.broadcast_to(np.eye(3), (*p_b.shape, 3))], axis=-1
        )
        tilt = np.swapaxes(planes.basis, -1, -2) @ se3.skew(planes.normal) @ R
        G = np.einsum("rk,hkai->hrai", self.rows, tilt[:, None] @ motion)
        result: Array = np.einsum("hrs,hrai,hab,hsbj->ij", W, G, planes.covariance[:, :2, :2], G)
        count, m = p_b.shape[:2]
        C = self.covariance_b[keep].reshape(count, m, 3, m, 3)
        N = se3.skew(planes.normal @ R)
        W = self.rows.T @ W @ self.rows
        result[:3, :3] += np.einsum("hkl,hab,hkblc,hdc->ad", W, N, C, N)
        return result


@dataclass(frozen=True, eq=False)
class OnPoints:
    """One known point of the board, (H, 3) in both frames with covariances (H, 3, 3).

    e = R p_b + t - p_a.
    """

    p_a: Array
    covariance_a: Array
    p_b: Array
    covariance_b: Array
    sigma: Array
    minimal: int = 3
    components: tuple[int, ...] = (0, 0, 0)

    def solve(self, sample: Index) -> Array:
        """Rigid alignment of three points."""
        return solvers.from_points(self.p_a[sample], self.p_b[sample])

    def distances(self, T_a_b: Array) -> Array:
        """Rms per axis."""
        p = self.p_b @ np.swapaxes(T_a_b[:, :3, :3], -1, -2) + T_a_b[:, None, :3, 3]
        result: Array = np.sqrt(np.mean((p - self.p_a) ** 2, axis=-1))
        return result

    def residuals(self, T_a_b: Array, keep: Index) -> tuple[Array, Array, Array]:
        """de = R (w x p_b + v)."""
        R, p_b = T_a_b[:3, :3], self.p_b[keep]
        J = np.concatenate([-R @ se3.skew(p_b), np.broadcast_to(R, (len(p_b), 3, 3))], axis=-1)
        C = self.covariance_a[keep] + R @ self.covariance_b[keep] @ R.T
        return se3.apply(T_a_b, p_b) - self.p_a[keep], J, C

    def noise_information(self, T_a_b: Array, keep: Index, W: Array) -> Array:
        """Noise in p_b acts as a lever: E (w x dp)^T W_b (w x dp), in the frame of b."""
        R, C = T_a_b[:3, :3], self.covariance_b[keep]
        basis = se3.skew(np.eye(3))  # the row i is e_i x
        result = np.zeros((6, 6))
        result[:3, :3] = np.einsum("iab,hbc,jdc,had->ij", basis, C, basis, R.T @ W @ R)
        return result


@dataclass(frozen=True, eq=False)
class OnPoses:
    """The pose of the board in both frames, (H, 4, 4) with covariances (H, 6, 6).

    r = [half w, t] of `T_a_t^-1 T_a_b T_b_t`, w the rotation vector; `half` is the lever (m) that
    makes metres of a tilt. `corners` (K, 3) of the board measure distances.
    """

    T_a_t: Array
    covariance_a: Array
    T_b_t: Array
    covariance_b: Array
    sigma: Array
    half: float
    corners: Array
    minimal: int = 1
    components: tuple[int, ...] = (0, 0, 1, 2, 2, 3)

    def solve(self, sample: Index) -> Array:
        """Each correspondence alone gives `T_a_t T_b_t^-1`."""
        h = sample[:, 0]
        result: Array = self.T_a_t[h] @ se3.inverse(self.T_b_t[h])
        return result

    def distances(self, T_a_b: Array) -> Array:
        """Rms per axis over the corners."""
        q = np.column_stack([self.corners, np.ones(len(self.corners))]).T
        p_b, p_a = self.T_b_t @ q, (self.T_a_t @ q)[:, :3]
        p = np.einsum("mij,hjk->mhik", T_a_b[:, :3], p_b)
        result: Array = np.sqrt(np.mean((p - p_a) ** 2, axis=(-2, -1)))
        return result

    def residuals(self, T_a_b: Array, keep: Index) -> tuple[Array, Array, Array]:
        """exp(xi_b) moves through the adjoint of `T_t_b`; dw = (I + [w]_x / 2) for small w."""
        D = se3.inverse(self.T_a_t[keep]) @ T_a_b @ self.T_b_t[keep]
        w = se3.log_so3(D[:, :3, :3])
        J = se3.adjoint(se3.inverse(self.T_b_t[keep]))
        J[:, :3] = (np.eye(3) + se3.skew(w) / 2) @ J[:, :3] * self.half
        J[:, 3:] = D[:, :3, :3] @ J[:, 3:]
        lever = np.repeat([self.half, 1.0], 3)
        C = (self.covariance_a[keep] + self.covariance_b[keep]) * np.outer(lever, lever)
        return np.concatenate([self.half * w, D[:, :3, 3]], axis=-1), J, C

    def noise_information(self, T_a_b: Array, keep: Index, W: Array) -> Array:
        """None: every pose has all its levers of its own."""
        return np.zeros((6, 6))
