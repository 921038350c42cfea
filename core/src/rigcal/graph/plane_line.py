"""The minimal solver for three planes seen by one sensor and three lines seen by a 2D laser."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.solvers import LEAST_VOLUME

# Noise turns a double root into a complex pair; its real part is still a good hypothesis.
_IMAGINARY = 0.05
_POLISH_STEPS = 2


def from_planes_and_lines(n_a: Array, d_a: Array, p_b: Array, v_b: Array) -> Array:
    """Three planes of frame a, each holding a line that b sees in its plane z = 0.

    Planes n_a (S, 3, 3), d_a (S, 3); points p_b and unit directions v_b (S, 3, 3) of the lines.
    `n_i . R v_i = 0` is P3P in its dual form (F. Vasconcelos, J. P. Barreto, U. Nunes, "A minimal
    solution for the extrinsic calibration of a camera and a laser-rangefinder", PAMI 2012): up to
    four pairs of rotations, the two of a pair half a turn of the scan plane apart. The translation
    is linear in `n_i . (R p_i + t) + d_i = 0`.
    """
    sample, R = _rotations(n_a, v_b)
    n, d = n_a[sample], d_a[sample]
    R = _polished(R, n, v_b[sample])
    rhs = -d - np.einsum("sij,sij->si", n @ R, p_b[sample])
    return se3.transform(R, np.linalg.solve(n, rhs[..., None])[..., 0])


def _rotations(n: Array, v: Array) -> tuple[NDArray[np.intp], Array]:
    """Samples (M,) and rotations (M, 3, 3) with `n_i . R v_i = 0`, i = 1, 2, 3.

    In the plane i = 1, 2 take the axes `f_i = n_i x n_3 / |.|` and `e_i = f_i x n_i`, so that
    `R v_i = x_i (e_i + p_i f_i)`. With `v_3 = a v_1 + b v_2` the third plane demands
    `x_2 = k x_1`, k = -a (n_3 . e_1) / (b (n_3 . e_2)). With p = p_1, q = k p_2 and c = v_1 . v_2,
    the unit lengths demand `q^2 = 1 + p^2 - k^2`, and the angle between the lines
    `q (e_1 . f_2 + p f_1 . f_2) = c (1 + p^2) - k (e_1 . e_2 + p f_1 . e_2)`. Squared, a quartic.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        f = np.cross(n[:, :2], n[:, 2:])
        f /= np.linalg.norm(f, axis=-1, keepdims=True)
        e = np.cross(f, n[:, :2])
        # a : b = |v_3 v_2| : |v_1 v_3|, determinants in the scan plane.
        weights = _turn(v[:, [2, 0]], v[:, [1, 2]]) * np.einsum("sj,sij->si", n[:, 2], e)
        k = -weights[:, 0] / weights[:, 1]
    skew_lines = np.abs(_turn(v[:, 0], v[:, 1])) > 1e-4
    well = np.flatnonzero(np.isfinite(k) & skew_lines & (np.abs(np.linalg.det(n)) > LEAST_VOLUME))
    e, f, v, k = e[well], f[well], v[well], k[well]
    c = np.einsum("si,si->s", v[:, 0], v[:, 1])
    ef, ff, ee, fe = (
        np.einsum("si,si->s", x[:, 0], y[:, 1]) for x, y in ((e, f), (f, f), (e, e), (f, e))
    )
    factor, rest = np.stack([ef, ff]), np.stack([c - k * ee, -k * fe, c])
    root, p = _real_roots(_quartic(factor, rest, k))
    with np.errstate(divide="ignore", invalid="ignore"):
        q = _value(rest[:, root], p) / _value(factor[:, root], p)
    finite = np.isfinite(q)
    root, p, q = root[finite], p[finite, None], q[finite, None]
    u1, u2 = e[root, 0] + p * f[root, 0], k[root, None] * e[root, 1] + q * f[root, 1]
    both = np.array([1.0, -1.0])[:, None, None]
    u1 /= np.linalg.norm(u1, axis=-1, keepdims=True)
    R = _turning(both * u1, both * u2, v[root, 0], v[root, 1]).reshape(-1, 3, 3)
    return np.tile(well[root], 2), R


def _turn(v: Array, w: Array) -> Array:
    """(...) sine of the angle from v to w in the scan plane."""
    result: Array = v[..., 0] * w[..., 1] - v[..., 1] * w[..., 0]
    return result


def _quartic(factor: Array, rest: Array, k: Array) -> Array:
    """(S, 5) coefficients, lowest first, of `(1 - k^2 + p^2) factor(p)^2 - rest(p)^2`."""
    b0, b1 = factor
    c0, c1, c2 = rest
    square = np.stack([b0**2, 2 * b0 * b1, b1**2])
    result = -np.stack([c0**2, 2 * c0 * c1, c1**2 + 2 * c0 * c2, 2 * c1 * c2, c2**2])
    result[:3] += (1 - k**2) * square
    result[2:] += square
    return result.T


def _real_roots(coefficients: Array) -> tuple[NDArray[np.intp], Array]:
    """Polynomials (M,) and their real roots (M,): eigenvalues of companion matrices."""
    with np.errstate(divide="ignore", invalid="ignore"):
        monic = coefficients[:, :-1] / coefficients[:, -1:]
    finite = np.flatnonzero(np.all(np.isfinite(monic), axis=1))
    companion = np.zeros((len(finite), 4, 4))
    companion[:, 1:, :3] = np.eye(3)
    companion[:, :, 3] = -monic[finite]
    roots = np.linalg.eigvals(companion)
    polynomial, which = np.nonzero(np.abs(roots.imag) < _IMAGINARY * (1 + np.abs(roots.real)))
    # Of a pair that is nearly double and complex, one is enough.
    once = roots.imag[polynomial, which] >= 0
    real = np.asarray(roots.real[polynomial[once], which[once]], np.float64)
    return finite[polynomial[once]], real


def _value(coefficients: Array, p: Array) -> Array:
    """(M,) values at p of polynomials (degree + 1, M), lowest coefficient first."""
    value = np.polynomial.polynomial.polyval(p, coefficients, tensor=False)
    return np.asarray(value, dtype=np.float64)


def _turning(u1: Array, u2: Array, v1: Array, v2: Array) -> Array:
    """(..., 3, 3) rotations that take unit vectors v1 (..., 3) to u1, and v2 into their plane."""

    def frame(x: Array, y: Array) -> Array:
        z = np.cross(x, y)
        z = z / np.linalg.norm(z, axis=-1, keepdims=True)
        return np.stack([x, np.cross(z, x), z], axis=-1)

    result: Array = frame(u1, u2) @ np.swapaxes(frame(v1, v2), -1, -2)
    return result


def _polished(R: Array, n: Array, v: Array) -> Array:
    """Newton's method on `n_i . R v_i = 0`: squaring and the quartic cost digits."""
    for _ in range(_POLISH_STEPS):
        n_b = n @ R
        f = np.einsum("sij,sij->si", n_b, v)
        J = np.cross(v, n_b)  # n . R (w x v) = w . (v x R^T n)
        step = np.zeros_like(f)
        regular = np.abs(np.linalg.det(J)) > 1e-6
        step[regular] = -np.linalg.solve(J[regular], f[regular][..., None])[..., 0]
        # Near a double root a step may lead anywhere.
        length = np.linalg.norm(step, axis=1, keepdims=True)
        R = R @ se3.exp_so3(step * np.minimum(1, 0.2 / np.maximum(length, 1e-12)))
    return R
