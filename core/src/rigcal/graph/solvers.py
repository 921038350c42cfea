"""Minimal solvers for the transform between two sensors, in batches.

Every solver takes S samples at once and returns (M, 4, 4) hypotheses `T_a_b`, M of any size:
samples without a solution give none. The one for planes and lines is in `plane_line`.
"""

from __future__ import annotations

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array

LEAST_VOLUME = 1e-3
"""Three planes are a degenerate sample when their unit normals span less."""
_LEAST_SPREAD_M = 0.05
_NEWTON_STEPS = 8


def from_planes(n_a: Array, d_a: Array, n_b: Array, d_b: Array) -> Array:
    """Three planes in both frames: n (S, 3, 3), d (S, 3), normals turned to the sensor's side.

    Rotation from the normals by SVD, `n_a = R n_b`; translation from `n_a . t = d_b - d_a`.
    Source: K. S. Arun et al., "Least-squares fitting of two 3-D point sets", PAMI 1987 (rotation);
    R. Unnikrishnan and M. Hebert, CMU-RI-TR-05-09 (translation from plane distances).
    """
    well = np.abs(np.linalg.det(n_a)) > LEAST_VOLUME
    n_a, d_a, n_b, d_b = n_a[well], d_a[well], n_b[well], d_b[well]
    R = se3.nearest_rotation(np.swapaxes(n_a, 1, 2) @ n_b)
    t = np.asarray(np.linalg.solve(n_a, (d_b - d_a)[..., None])[..., 0], np.float64)
    return se3.transform(R, t)


def from_points(p_a: Array, p_b: Array) -> Array:
    """Three or more points in both frames, (S, m, 3); none where they lie on a line.

    Source: S. Umeyama, "Least-squares estimation of transformation parameters between two point
    patterns", PAMI 1991, eq. 40-43, without scale.
    """
    c_a, c_b = p_a.mean(axis=1), p_b.mean(axis=1)
    A, B = p_a - c_a[:, None], p_b - c_b[:, None]
    well = np.linalg.svd(A, compute_uv=False)[:, 1] > _LEAST_SPREAD_M
    R = se3.nearest_rotation(np.swapaxes(A, 1, 2) @ B)[well]
    return se3.transform(R, c_a[well] - np.einsum("sij,sj->si", R, c_b[well]))


def from_planes_and_points(n_a: Array, d_a: Array, p_b: Array, near_a: Array) -> Array:
    """Six planes of frame a, n (S, 6, 3), d (S, 6), each holding a point of frame b, (S, 6, 3).

    `n_i . (R p_i + t) + d_i = 0` is point-to-plane registration with known partners (Y. Chen and
    G. Medioni, "Object modelling by registration of multiple range images", 1992, eq. 5). It has
    many roots; the right one is next to the transform that takes the points to `near_a` (S, 6, 3),
    places on the same boards, and Newton's method goes there.
    """
    c_a, c_b = near_a.mean(axis=1), p_b.mean(axis=1)
    H = np.swapaxes(near_a - c_a[:, None], 1, 2) @ (p_b - c_b[:, None])
    R = se3.nearest_rotation(H)
    T = se3.transform(R, c_a - np.einsum("sij,sj->si", R, c_b))
    for _ in range(_NEWTON_STEPS):
        f, J = _on_planes(T, n_a, d_a, p_b)
        well = np.abs(np.linalg.det(J)) > 1e-6
        T, n_a, d_a, p_b = T[well], n_a[well], d_a[well], p_b[well]
        T = T @ se3.exp(-np.linalg.solve(J[well], f[well][..., None])[..., 0])
    exact: Array = T[np.abs(_on_planes(T, n_a, d_a, p_b)[0]).max(axis=1, initial=0.0) < 1e-6]
    return exact


def _on_planes(T: Array, n_a: Array, d_a: Array, p_b: Array) -> tuple[Array, Array]:
    """Distances (S, m) of points from planes, and Jacobians (S, m, 6), right perturbation."""
    n_b = n_a @ T[:, :3, :3]
    f = np.einsum("smi,smi->sm", n_b, p_b) + np.einsum("smi,si->sm", n_a, T[:, :3, 3]) + d_a
    return f, np.concatenate([np.cross(p_b, n_b), n_b], axis=-1)
