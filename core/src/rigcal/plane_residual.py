"""Residuals of a plane or its trace, and the constant-cost residual of beams that meet it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from rigcal.errors import ObservationError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import plane_of_target
from rigcal.plugin.contract import Stacked
from rigcal.plugin.refinable import Refined

_E_Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class PlaneResidual:
    """r = A [n; d] / s, linear in the target's plane `n . p + d = 0`; A is (m, 4), whitened.

    s is 1, or with `planar` the length of n in the sensor's x-y plane: a scan in z = 0 sees only
    the trace of the target's plane, whose normalised form has n_xy of unit length.
    """

    A: Array
    planar: bool = False

    @property
    def block(self) -> int:
        """All rows belong to one measurement of a plane or line."""
        return len(self.A)

    @property
    def dof(self) -> int:
        """One per row."""
        return len(self.A)

    def __call__(self, T_s_t: Array) -> tuple[Array, Array]:
        """r (m,) and J (m, 6) by a right perturbation of `T_s_t`."""
        return self.stack([self])(T_s_t[None])

    @classmethod
    def stack(cls, residuals: Sequence[Self]) -> Stacked:
        """All at once: dn = -R [e_z]_x w, dd = -dn . t - v_z."""
        A = np.stack([r.A for r in residuals])
        planar = np.array([r.planar for r in residuals])[:, None]

        def evaluate(T_s_t: Array) -> tuple[Array, Array]:
            n, d = plane_of_target(T_s_t)
            dpi = np.zeros((len(A), 4, 6))
            dpi[:, :3, :3] = -T_s_t[:, :3, :3] @ se3.skew(_E_Z)
            dpi[:, 3] = -np.einsum("ki,kij->kj", T_s_t[:, :3, 3], dpi[:, :3])
            dpi[:, 3, 5] = -1.0
            r = np.einsum("kmi,ki->km", A, np.column_stack([n, d]))
            J = A @ dpi
            s = np.maximum(np.hypot(n[:, 0], n[:, 1]), 1e-9)[:, None]
            ds = np.einsum("ki,kij->kj", n[:, :2], dpi[:, :2]) / s
            r_planar = r / s
            J_planar = (J - r_planar[:, :, None] * ds[:, None, :]) / s[:, :, None]
            r = np.where(planar, r_planar, r)
            J = np.where(planar[:, :, None], J_planar, J)
            return r.reshape(-1), J.reshape(-1, 6)

        return evaluate


@dataclass(frozen=True, eq=False)
class BiasedPlaneResidual:
    """r = plane(T_s_t) + B (b - b0) + c: of beams whose ranges have a bias b, b0 where it starts.

    B and c are (m,); the bias is the one number that it may be refined with.
    """

    plane: PlaneResidual
    B: Array
    c: Array
    b0: float

    @property
    def block(self) -> int:
        """All rows belong to one measurement of a plane or line."""
        return len(self.c)

    @property
    def dof(self) -> int:
        """One per row."""
        return len(self.c)

    def __call__(self, T_s_t: Array) -> tuple[Array, Array]:
        """r (m,) and J (m, 6) at the bias where it starts."""
        return self.stack([self])(T_s_t[None])

    @classmethod
    def stack(cls, residuals: Sequence[Self]) -> Stacked:
        """All at once."""
        plane = PlaneResidual.stack([r.plane for r in residuals])
        c = np.concatenate([r.c for r in residuals])

        def evaluate(T_s_t: Array) -> tuple[Array, Array]:
            r, J = plane(T_s_t)
            return r + c, J

        return evaluate

    @classmethod
    def refined(cls, residuals: Sequence[Self]) -> Refined:
        """The same as a function of the bias too."""
        start, B = cls.stack(residuals), np.concatenate([r.B for r in residuals])
        b0 = residuals[0].b0

        def evaluate(T_s_t: Array, values: Array) -> tuple[Array, Array, Array]:
            r, J = start(T_s_t)
            return r + B * (values[0] - b0), J, B[:, None]

        return evaluate


def beam_residual(
    directions: Array,
    ranges: Array,
    sigma: Array,
    normal: Array,
    d: float,
    *,
    planar: bool = False,
    origins: Array | None = None,
) -> PlaneResidual:
    """Measured range minus the range at which each beam meets the target's plane, whitened.

    `t_i = -(n . p0_i + d) / (n . rho_i)` (MSG-Cal, eq. 4.12). directions rho (N, 3) unit, ranges
    (N,), sigma (N,) of the range (m), origins p0 (N, 3) or None for the sensor's origin; normal
    and d are a first plane (for `planar`, beams in z = 0: a first line, normal with z = 0).

    The sum of squares over all beams is replaced by its sufficient statistic: with the
    maximum-likelihood plane pi_0 and the points q_i where the beams meet it,
    `M = sum [q_i; 1] [q_i; 1]^T / (sigma_i n_0 . rho_i)^2`; the cost of any plane pi is
    `pi^T M pi` up to a constant and terms of third order. So an edge has 3 rows (2 for a scan)
    however many beams it has. ObservationError if the beams do not determine a plane (line).
    """
    p0 = np.zeros(3) if origins is None else origins
    rows, _, _ = at_best_plane(directions, ranges, sigma, np.append(normal, d), p0, planar)
    values, vectors = _leading(rows, planar)
    return PlaneResidual(np.sqrt(values[:, None]) * vectors.T, planar)


def biased_beam_residual(
    directions: Array,
    ranges: Array,
    sigma: Array,
    normal: Array,
    d: float,
    *,
    planar: bool = False,
    origins: Array | None = None,
    bias_m: float = 0.0,
    gain: float | Array = 1.0,
) -> BiasedPlaneResidual:
    """`beam_residual` as a function of a bias of all ranges too, which starts at `bias_m`.

    `ranges` are without that first bias; a bias lengthens them by `gain` (N,) times itself. The
    errors are linear in it. The part of its effect that a plane can take up adds to the rows of
    `beam_residual`; the part that bends the plane is one row more.
    """
    p0 = np.zeros(3) if origins is None else origins
    rows, error, _ = at_best_plane(directions, ranges, sigma, np.append(normal, d), p0, planar)
    values, vectors = _leading(rows, planar)
    root = np.sqrt(values)
    by_bias = np.broadcast_to(-gain / sigma, error.shape)
    along = vectors.T @ (rows.T @ by_bias) / root
    bend = by_bias - rows @ (vectors @ (along / root))
    size = float(np.linalg.norm(bend))
    is_told = size > 1e-9 * float(np.linalg.norm(by_bias))
    return BiasedPlaneResidual(
        PlaneResidual(np.vstack([root[:, None] * vectors.T, np.zeros(4)]), planar),
        np.append(along, size if is_told else 0.0),
        np.append(np.zeros(len(root)), float(bend @ error) / size if is_told else 0.0),
        bias_m,
    )


def at_best_plane(
    directions: Array, ranges: Array, sigma: Array, pi: Array, p0: Array, planar: bool
) -> tuple[Array, Array, Array]:
    """Derivative (N, 4) by the plane pi = [n, d], and error (N,), at the best plane; whitened.

    With them that plane (4,). Row i is `[q_i; 1] / (sigma_i n . rho_i)`, q_i where beam i meets it.
    """
    rank = 2 if planar else 3
    pi = pi / np.linalg.norm(pi[:3])
    for _ in range(4):
        cosine = directions @ pi[:3]
        q, w = _meet(p0, directions, pi), 1 / (sigma * cosine)
        error = ranges + (np.einsum("...i,i->...", p0, pi[:3]) + pi[3]) / cosine
        rows = np.column_stack([q, np.ones(len(q))]) * w[:, None]
        if planar:
            rows[:, 2] = 0.0
        # d(error) = [q; 1] . dpi / cosine; the step along pi itself changes nothing.
        values, vectors = _leading(rows, planar)
        if len(ranges) < rank or values[0] <= 1e-12 * values[-1]:
            kind = "line" if planar else "plane"
            raise ObservationError(f"{len(ranges)} beams do not determine a {kind}")
        pi = pi - vectors @ ((vectors.T @ (rows.T @ (error / sigma))) / values)
        pi /= np.linalg.norm(pi[:3])
    cosine = directions @ pi[:3]
    rows = np.column_stack([_meet(p0, directions, pi), np.ones(len(ranges))])
    rows /= (sigma * cosine)[:, None]
    if planar:
        rows[:, 2] = 0.0
    error = ranges + (np.einsum("...i,i->...", p0, pi[:3]) + pi[3]) / cosine
    return rows, error / sigma, pi


def _leading(rows: Array, planar: bool) -> tuple[Array, Array]:
    """The eigenvalues of `rows^T rows` that a plane (3) or a line (2) has, and their vectors."""
    rank = 2 if planar else 3
    values, vectors = np.linalg.eigh(rows.T @ rows)
    return values[-rank:], vectors[:, -rank:]


def _meet(p0: Array, directions: Array, pi: Array) -> Array:
    """(N, 3) points where beams meet a plane pi = [n, d]."""
    t = -(np.einsum("...i,i->...", p0, pi[:3]) + pi[3]) / (directions @ pi[:3])
    result: Array = p0 + t[:, None] * directions
    return result
