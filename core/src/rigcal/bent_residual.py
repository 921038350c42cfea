"""The constant-cost residual of beams that meet a bent board."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.plane_residual import at_best_plane
from rigcal.plugin.contract import Stacked
from rigcal.plugin.refinable import Refined

_E_Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class BentBeamResidual:
    """r = A [c / s; b - b0; 1]: errors of beams against a bent board.

    On the plane (scan: the line) that fits the beams best, `q(u) = F [1; u]` with F (3, 1 + D) and
    D = 2 (1). There the height over the face, `z - w(x, y)` in the target's frame, is a polynomial
    of degree 2 in u with coefficients c (6,), for a scan (3,). s is 1, or for a scan the length of
    the target's normal in the plane z = 0, and negative where that normal does not point to the
    side of `normal`, that of the plane. A is (m, 7) or (m, 4), whitened, with a column more if the
    ranges' bias b is asked for, which starts at b0. The bend starts at `bend`.
    """

    A: Array
    F: Array
    normal: Array
    bend: Array
    b0: float | None = None

    @property
    def block(self) -> int:
        """All rows belong to one measurement of a face."""
        return len(self.A)

    @property
    def dof(self) -> int:
        """One per row."""
        return len(self.A)

    def __call__(self, T_s_t: Array) -> tuple[Array, Array]:
        """r (m,) and J (m, 6) at the bend and the bias where they start."""
        return self.stack([self])(T_s_t[None])

    @classmethod
    def stack(cls, residuals: Sequence[Self]) -> Stacked:
        """All at once."""
        refined, first = cls.refined(residuals), residuals[0]
        start = first.bend if first.b0 is None else np.append(first.b0, first.bend)

        def evaluate(T_s_t: Array) -> tuple[Array, Array]:
            r, J, _ = refined(T_s_t, start)
            return r, J

        return evaluate

    @classmethod
    def refined(cls, residuals: Sequence[Self]) -> Refined:
        """The same as a function of the bias, if it is asked for, and the bend (3,)."""
        A, F, normal = (np.stack([getattr(r, f) for r in residuals]) for f in ("A", "F", "normal"))
        b0, planar = residuals[0].b0, F.shape[2] == 2
        count = 3 if planar else 6
        A_c, A_b, A_1 = A[:, :, :count], A[:, :, count:-1], A[:, :, -1]

        def evaluate(T_s_t: Array, values: Array) -> tuple[Array, Array, Array]:
            c, dc, dc_bend = _heights(F, T_s_t, values[-3:])
            s, ds = _side(T_s_t, normal, planar)
            c, dc_bend = c / s[:, None], dc_bend / s[:, None, None]
            dc = (dc - c[:, :, None] * ds[:, None, :]) / s[:, None, None]
            r = np.einsum("kmi,ki->km", A_c, c) + A_1
            J_values = A_c @ dc_bend
            if b0 is not None:
                r = r + A_b[:, :, 0] * (values[0] - b0)
                J_values = np.concatenate([A_b, J_values], axis=2)
            return r.ravel(), (A_c @ dc).reshape(-1, 6), J_values.reshape(r.size, -1)

        return evaluate


def bent_beam_residual(
    directions: Array,
    ranges: Array,
    sigma: Array,
    normal: Array,
    d: float,
    bend: Array,
    *,
    planar: bool = False,
    origins: Array | None = None,
    bias_m: float | None = None,
    gain: float | Array = 1.0,
) -> BentBeamResidual:
    """Measured range minus the range at which each beam meets the target's bent face, whitened.

    As `rigcal.residual.beam_residual`, and with a `bias_m` as `biased_beam_residual`. With the
    height h(u) of the best plane over the face at the foot of a beam, its error is
    `h(u_i) / (n . rho_i)` to first order, which is linear in the coefficients of h. A QR
    factorisation of all rows leaves at most 6 of them (3 for a scan), one more with a bias, and a
    constant cost. ObservationError if the beams do not determine a plane (line).
    """
    p0 = np.zeros(3) if origins is None else origins
    rows, error, pi = at_best_plane(directions, ranges, sigma, np.append(normal, d), p0, planar)
    weight = rows[:, 3:]
    feet = rows[:, :3] / weight
    center = feet.mean(axis=0)
    axes = np.linalg.svd(feet - center, full_matrices=False)[2][: 1 if planar else 2]
    u = np.column_stack([np.ones(len(feet)), (feet - center) @ axes.T])
    i, j = np.triu_indices(u.shape[1])
    columns = [u[:, i] * u[:, j] * weight]
    if bias_m is not None:
        columns.append(np.broadcast_to(-gain / sigma, error.shape)[:, None])
    every = np.column_stack([*columns, error])
    A = np.asarray(np.linalg.qr(every, mode="r"), np.float64)[: every.shape[1] - 1]
    return BentBeamResidual(A, np.column_stack([center, axes.T]), pi[:3], bend, bias_m)


def _heights(F: Array, T_s_t: Array, bend: Array) -> tuple[Array, Array, Array]:
    """Coefficients (K, M) of the height over the face, and their derivatives by pose and bend.

    In the target's frame the plane is `P [1; u]`, `P = T_t_s F`, which moves by `p x w - v`.
    """
    R, t = T_s_t[:, :3, :3], T_s_t[:, :3, 3]
    P = F.copy()
    P[:, :, 0] -= t
    P = np.swapaxes(R, 1, 2) @ P
    dP = np.zeros((*P.shape, 6))
    dP[..., :3] = np.moveaxis(se3.skew(np.swapaxes(P, 1, 2)), 1, 2)
    dP[:, :, 0, 3:] = -np.eye(3)
    one = np.eye(P.shape[2])[0]
    (x, y, z), (dx, dy, dz) = np.moveaxis(P, 1, 0), np.moveaxis(dP, (1, 3), (0, 1))
    by_bend = -np.stack([_products(x, x) / 2, _products(y, y) / 2, _products(x, y)], axis=-1)
    k_x, k_y, k_xy = bend
    slope_x, slope_y = k_x * x + k_xy * y, k_y * y + k_xy * x
    dc = _products(one, dz) - _products(slope_x, dx) - _products(slope_y, dy)
    return _products(one, z) + by_bend @ bend, np.moveaxis(dc, 0, 2), by_bend


def _products(a: Array, b: Array) -> Array:
    """(..., M) coefficients of the product of two functions `a . [1; u]` and `b . [1; u]`.

    Of 1, u, v, u^2, uv, v^2, or of 1, u, u^2.
    """
    i, j = np.triu_indices(b.shape[-1])
    result: Array = a[..., i] * b[..., j]
    return result + np.where(i < j, a[..., j] * b[..., i], 0.0)


def _side(T_s_t: Array, normal: Array, planar: bool) -> tuple[Array, Array]:
    """s (K,) of `BentBeamResidual`, and its derivative (K, 6) by the pose."""
    n = T_s_t[:, :3, 2]
    sign = np.where(np.einsum("ki,ki->k", n, normal) < 0, -1.0, 1.0)
    if not planar:
        return sign, np.zeros((len(n), 6))
    size = np.maximum(np.hypot(n[:, 0], n[:, 1]), 1e-9)
    ds = np.zeros((len(n), 6))
    dn = -T_s_t[:, :3, :3] @ se3.skew(_E_Z)
    ds[:, :3] = np.einsum("ki,kij->kj", n[:, :2], dn[:, :2]) * (sign / size)[:, None]
    return sign * size, ds
