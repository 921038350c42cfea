"""Minimal and linear solvers for the transform between two sensors, in batches.

Every solver takes S samples at once and returns (M, 4, 4) hypotheses `T_a_b`, M of any size:
samples without a solution give none.
"""

from __future__ import annotations

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array

STARTS = 24
_NEWTON_STEPS = 12


def from_planes(n_a: Array, d_a: Array, n_b: Array, d_b: Array) -> Array:
    """Three planes in both frames: n (S, 3, 3), d (S, 3), normals turned to the sensor's side.

    Rotation from the normals by SVD, `n_a = R n_b`; translation from `n_a . t = d_b - d_a`.
    Source: K. S. Arun et al., "Least-squares fitting of two 3-D point sets", PAMI 1987 (rotation);
    R. Unnikrishnan and M. Hebert, CMU-RI-TR-05-09 (translation from plane distances).
    """
    R = se3.nearest_rotation(np.swapaxes(n_a, 1, 2) @ n_b)
    well = np.abs(np.linalg.det(n_a)) > 1e-3
    t = np.linalg.solve(n_a[well], (d_b - d_a)[well][..., None])[..., 0]
    return se3.transform(R[well], t)


def from_planes_and_lines(n_a: Array, d_a: Array, p_b: Array, v_b: Array, starts: Array) -> Array:
    """Three planes of frame a, each containing a line of frame b: points p_b, directions v_b
    (S, 3, 3), planes n_a (S, 3, 3), d_a (S, 3).

    The rotation solves the three equations `n_i . R v_i = 0`; up to eight solutions exist
    (F. Vasconcelos, J. P. Barreto, U. Nunes, "A minimal solution for the extrinsic calibration of
    a camera and a laser-rangefinder", PAMI 2012). They are found by Newton's method on SO(3) from
    `starts` (K, 3, 3) for all samples at once; the translation is then linear in
    `n_i . (R p_i + t) + d_i = 0`.
    """
    samples, count = len(n_a), len(starts)
    R = np.repeat(starts[None], samples, axis=0).reshape(-1, 3, 3)
    n, v = (np.repeat(x, count, axis=0) for x in (n_a, v_b))
    for _ in range(_NEWTON_STEPS):
        nR = n @ R
        f = np.einsum("sij,sij->si", nR, v)
        J = np.cross(v, nR)  # n . R (w x v) = w . (v x R^T n)
        regular = np.abs(np.linalg.det(J)) > 1e-6
        step = np.zeros_like(f)
        step[regular] = -np.linalg.solve(J[regular], f[regular][..., None])[..., 0]
        # A long step means a far root or a nearly singular point; keep the walk on the map.
        length = np.linalg.norm(step, axis=1, keepdims=True)
        R = R @ se3.exp_so3(step * np.minimum(1, 0.7 / np.maximum(length, 1e-12)))
    f = np.einsum("sij,sij->si", n @ R, v)
    found = (np.abs(f).max(axis=1) < 1e-9) & (np.abs(np.linalg.det(n)) > 1e-3)
    sample = np.repeat(np.arange(samples), count)[found]
    R, sample = _distinct(R[found], sample)
    rhs = -d_a[sample] - np.einsum("sij,sij->si", n_a[sample] @ R, p_b[sample])
    t = np.linalg.solve(n_a[sample], rhs[..., None])[..., 0]
    return se3.transform(R, t)


def _distinct(R: Array, sample: Array) -> tuple[Array, Array]:
    """Each root once: several starts walk to the same one."""
    keys = np.column_stack([sample, np.round(R.reshape(-1, 9) * 1e4)])
    first = np.unique(keys, axis=0, return_index=True)[1]
    return R[first], sample[first]


def from_points(p_a: Array, p_b: Array) -> Array:
    """Three points in both frames, (S, 3, 3). Source: S. Umeyama, PAMI 1991, without scale."""
    c_a, c_b = p_a.mean(axis=1), p_b.mean(axis=1)
    A, B = p_a - c_a[:, None], p_b - c_b[:, None]
    spread = np.linalg.svd(A, compute_uv=False)[:, 1]
    well = spread > 0.05  # collinear points leave the rotation about their line open
    R = se3.nearest_rotation(np.swapaxes(A, 1, 2) @ B)[well]
    return se3.transform(R, c_a[well] - np.einsum("sij,sj->si", R, c_b[well]))


def random_rotations(count: int, rng: np.random.Generator) -> Array:
    """(count, 3, 3) rotations uniform on SO(3)."""
    return se3.rotation_from_quaternion(rng.normal(size=(count, 4)))
