"""Rigid transforms as (..., 4, 4) arrays.

`T_a_b` takes coordinates in frame b to coordinates in frame a: `p_a = T_a_b @ p_b`. Tangent vectors
are [rotation (rad), translation (m)] and perturb on the right: `T exp(xi)`. All functions broadcast
over leading dimensions. Source: J. Sola et al., "A micro Lie theory for state estimation in
robotics", 2018, with rotation first, as in GTSAM.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SMALL_ANGLE = 1e-5


def skew(v: Array) -> Array:
    """(..., 3, 3) cross-product matrices of (..., 3) vectors."""
    v = np.asarray(v, dtype=np.float64)
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    zero = np.zeros_like(x)
    rows = [zero, -z, y, z, zero, -x, -y, x, zero]
    return np.stack(rows, axis=-1).reshape((*v.shape[:-1], 3, 3))


def transform(R: Array, t: Array) -> Array:
    """(..., 4, 4) transforms from (..., 3, 3) rotations and (..., 3) translations."""
    R, t = np.asarray(R, dtype=np.float64), np.asarray(t, dtype=np.float64)
    shape = np.broadcast_shapes(R.shape[:-2], t.shape[:-1])
    T = np.zeros((*shape, 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, t, 1.0
    return T


def inverse(T: Array) -> Array:
    """(..., 4, 4) inverses: `T_b_a` of `T_a_b`."""
    T = np.asarray(T, dtype=np.float64)
    R_transposed = np.swapaxes(T[..., :3, :3], -1, -2)
    return transform(R_transposed, -np.einsum("...ij,...j->...i", R_transposed, T[..., :3, 3]))


def apply(T_a_b: Array, p_b: Array) -> Array:
    """Points (..., 3) of frame b in frame a; one transform (4, 4) for points of any shape."""
    T = np.asarray(T_a_b, dtype=np.float64)
    result: Array = np.asarray(p_b, dtype=np.float64) @ T[:3, :3].T + T[:3, 3]
    return result


def _exp_coefficients(angle: Array) -> tuple[Array, Array, Array]:
    """sin(a)/a, (1-cos a)/a^2 and (a - sin a)/a^3, with their series near zero."""
    small = angle < _SMALL_ANGLE
    a = np.where(small, 1.0, angle)
    square = angle**2
    return (
        np.where(small, 1 - square / 6, np.sin(a) / a),
        np.where(small, 0.5 - square / 24, 2 * np.sin(a / 2) ** 2 / a**2),
        # The closed form cancels badly long before the angle is tiny.
        np.where(angle < 1e-3, 1 / 6 - square / 120, (a - np.sin(a)) / a**3),
    )


def exp_so3(w: Array) -> Array:
    """(..., 3, 3) rotations of (..., 3) rotation vectors (Rodrigues)."""
    w = np.asarray(w, dtype=np.float64)
    s, c, _ = _exp_coefficients(np.linalg.norm(w, axis=-1))
    W = skew(w)
    result: Array = np.eye(3) + s[..., None, None] * W + c[..., None, None] * (W @ W)
    return result


def log_so3(R: Array) -> Array:
    """(..., 3) rotation vectors of (..., 3, 3) rotations, angle in [0, pi]."""
    q = quaternion_from_rotation(R)
    q = np.where(q[..., 3:] < 0, -q, q)
    sine = np.linalg.norm(q[..., :3], axis=-1)
    angle = 2 * np.arctan2(sine, q[..., 3])
    small = sine < _SMALL_ANGLE
    factor = np.where(small, 2 / np.where(small, q[..., 3], 1), angle / np.where(small, 1, sine))
    result: Array = factor[..., None] * q[..., :3]
    return result


def exp(xi: Array) -> Array:
    """(..., 4, 4) transforms of (..., 6) tangent vectors [rotation, translation]."""
    xi = np.asarray(xi, dtype=np.float64)
    w, v = xi[..., :3], xi[..., 3:]
    _, c, d = _exp_coefficients(np.linalg.norm(w, axis=-1))
    W = skew(w)
    V = np.eye(3) + c[..., None, None] * W + d[..., None, None] * (W @ W)
    return transform(exp_so3(w), np.einsum("...ij,...j->...i", V, v))


def log(T: Array) -> Array:
    """(..., 6) tangent vectors [rotation, translation] of (..., 4, 4) transforms."""
    T = np.asarray(T, dtype=np.float64)
    w = log_so3(T[..., :3, :3])
    _, c, d = _exp_coefficients(np.linalg.norm(w, axis=-1))
    W = skew(w)
    V = np.eye(3) + c[..., None, None] * W + d[..., None, None] * (W @ W)
    v = np.linalg.solve(V, T[..., :3, 3][..., None])[..., 0]
    return np.concatenate([w, v], axis=-1)


def adjoint(T: Array) -> Array:
    """(..., 6, 6) adjoints: `T exp(xi) T^-1 = exp(adjoint(T) xi)`."""
    T = np.asarray(T, dtype=np.float64)
    R = T[..., :3, :3]
    A = np.zeros((*T.shape[:-2], 6, 6))
    A[..., :3, :3] = A[..., 3:, 3:] = R
    A[..., 3:, :3] = skew(T[..., :3, 3]) @ R
    return A


def nearest_rotation(M: Array) -> Array:
    """(..., 3, 3) rotations nearest to M in the Frobenius norm (Kabsch; Umeyama 1991)."""
    U, _, Vt = np.linalg.svd(np.asarray(M, dtype=np.float64))
    U[..., :, 2] *= np.linalg.det(U @ Vt)[..., None]
    result: Array = U @ Vt
    return result


def rotation_from_quaternion(q: Array) -> Array:
    """(..., 3, 3) rotations of (..., 4) quaternions x, y, z, w (normalised here)."""
    q = np.asarray(q, dtype=np.float64)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    V = skew(q[..., :3])
    result: Array = np.eye(3) + 2 * q[..., 3, None, None] * V + 2 * (V @ V)
    return result


def quaternion_from_rotation(R: Array) -> Array:
    """(..., 4) quaternions x, y, z, w with w >= 0 of (..., 3, 3) rotations.

    The eigenvector of the largest eigenvalue of Bar-Itzhack's matrix (2000): no branches, and
    accurate for every angle.
    """
    R = np.asarray(R, dtype=np.float64)
    K = np.zeros((*R.shape[:-2], 4, 4))
    trace = np.trace(R, axis1=-2, axis2=-1)
    K[..., :3, :3] = R + np.swapaxes(R, -1, -2) - trace[..., None, None] * np.eye(3)
    for i, (a, b) in enumerate(((2, 1), (0, 2), (1, 0))):
        K[..., i, 3] = K[..., 3, i] = R[..., a, b] - R[..., b, a]
    K[..., 3, 3] = trace
    q = np.linalg.eigh(K)[1][..., :, -1]
    return np.where(q[..., 3:] < 0, -q, q)


def rotation_from_rpy(rpy: Array) -> Array:
    """(..., 3, 3) rotations of (..., 3) roll, pitch, yaw (rad) about fixed x, y, z, as in URDF."""
    rpy = np.asarray(rpy, dtype=np.float64)
    axes = np.eye(3)
    roll, pitch, yaw = (exp_so3(rpy[..., i, None] * axes[i]) for i in range(3))
    result: Array = yaw @ pitch @ roll
    return result


def rpy_from_rotation(R: Array) -> Array:
    """(..., 3) roll, pitch, yaw (rad) about fixed x, y, z of (..., 3, 3) rotations, as in URDF.

    Yaw is taken out before the other two are read off, so that a pitch of 90 degrees costs no
    accuracy.
    """
    R = np.asarray(R, dtype=np.float64)
    yaw = np.arctan2(R[..., 1, 0], R[..., 0, 0])
    sin, cos = np.sin(yaw), np.cos(yaw)
    pitch = np.arctan2(-R[..., 2, 0], cos * R[..., 0, 0] + sin * R[..., 1, 0])
    across = cos[..., None] * R[..., 1, :] - sin[..., None] * R[..., 0, :]
    roll = np.arctan2(-across[..., 2], across[..., 1])
    return np.stack([roll, pitch, yaw], axis=-1)


def rotation_angle(R: Array) -> Array:
    """(...) geodesic angles (rad) of (..., 3, 3) rotations."""
    result: Array = np.linalg.norm(log_so3(R), axis=-1)
    return result
