"""Default residuals by geometry; with those of planes and beams, all that core offers.

Each implements `rigcal.plugin.StackableResidual`: whitened error and Jacobian as a function of
`T_s_t`, for many observations at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from rigcal.bent_residual import BentBeamResidual, bent_beam_residual
from rigcal.errors import ObservationError, RigcalError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import tangent_basis
from rigcal.observation import Candidate, LineGeometry, PlaneGeometry, PointGeometry, PoseGeometry
from rigcal.plane_residual import (
    BiasedPlaneResidual,
    PlaneResidual,
    beam_residual,
    biased_beam_residual,
)
from rigcal.plugin.answers import check_rows
from rigcal.plugin.contract import Residual, SensorConfig, SensorType, Stacked
from rigcal.targets.target import Target

__all__ = [
    "BentBeamResidual",
    "BiasedPlaneResidual",
    "PlaneResidual",
    "PointResidual",
    "PoseResidual",
    "beam_residual",
    "bent_beam_residual",
    "biased_beam_residual",
    "residual_of",
    "residual_of_geometry",
    "whitener",
]


def whitener(covariance: Array) -> Array:
    """W (m, m) with `W^T W = covariance^-1`; ObservationError if it is not positive definite."""
    try:
        L = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        raise ObservationError(
            "a covariance is not positive definite (its eigenvalues are "
            f"{np.linalg.eigvalsh(covariance)}); a detector must report variances above zero"
        ) from None
    result: Array = np.linalg.inv(L)
    return result


@dataclass(frozen=True, eq=False)
class PoseResidual:
    """r = W [Log(R_m^T R); R_m^T (t - t_m)], which is Log(T_m^-1 T) to first order."""

    T_s_t: Array
    W: Array
    block: int = 6
    dof: int = 6

    def __call__(self, T_s_t: Array) -> tuple[Array, Array]:
        """r (6,) and J (6, 6); the rotation's part is the inverse right Jacobian of SO(3)."""
        return self.stack([self])(T_s_t[None])

    @classmethod
    def stack(cls, residuals: Sequence[Self]) -> Stacked:
        """All at once."""
        T_t_s_measured = se3.inverse(np.stack([r.T_s_t for r in residuals]))
        W = np.stack([r.W for r in residuals])

        def evaluate(T_s_t: Array) -> tuple[Array, Array]:
            D = T_t_s_measured @ T_s_t
            w = se3.log_so3(D[:, :3, :3])
            J = np.zeros((len(D), 6, 6))
            J[:, :3, :3], J[:, 3:, 3:] = _inverse_right_jacobian(w), D[:, :3, :3]
            r = np.einsum("kij,kj->ki", W, np.concatenate([w, D[:, :3, 3]], axis=1))
            return r.reshape(-1), (W @ J).reshape(-1, 6)

        return evaluate


def _inverse_right_jacobian(w: Array) -> Array:
    """(..., 3, 3) `Jr^-1(w)` (Sola et al. 2018, eq. 144)."""
    angle, K = np.linalg.norm(w, axis=-1), se3.skew(w)
    near_zero = angle < 1e-4
    a = np.where(near_zero, 1.0, angle)
    c = np.where(near_zero, 1 / 12, 1 / a**2 - 1 / (2 * a * np.tan(a / 2)))
    result: Array = np.eye(3) + K / 2 + c[..., None, None] * (K @ K)
    return result


@dataclass(frozen=True, eq=False)
class PointResidual:
    """r = W (T_s_t p_t - p_s)."""

    p_t: Array
    p_s: Array
    W: Array
    block: int = 3
    dof: int = 3

    def __call__(self, T_s_t: Array) -> tuple[Array, Array]:
        """r (3,) and J (3, 6) = W R [-[p_t]_x, I]."""
        return self.stack([self])(T_s_t[None])

    @classmethod
    def stack(cls, residuals: Sequence[Self]) -> Stacked:
        """All at once."""
        p_t, p_s, W = (np.stack([getattr(r, f) for r in residuals]) for f in ("p_t", "p_s", "W"))

        def evaluate(T_s_t: Array) -> tuple[Array, Array]:
            R = T_s_t[:, :3, :3]
            J = np.concatenate([-R @ se3.skew(p_t), R], axis=2)
            e = np.einsum("kij,kj->ki", R, p_t) + T_s_t[:, :3, 3] - p_s
            return np.einsum("kij,kj->ki", W, e).reshape(-1), (W @ J).reshape(-1, 6)

        return evaluate


def residual_of(
    kind: SensorType, candidate: Candidate, config: SensorConfig, target: Target
) -> Residual:
    """The sensor type's own residual, or the default one of the geometry.

    A candidate made by hand has the default one. ObservationError if the
    type's own cannot be made of the candidate's measurements or is no residual,
    or if the target may be bent, which a geometry does not tell.
    """
    if kind.residual is None or candidate.by_hand:
        if target.may_bend:
            raise ObservationError(
                "a pose, plane, line or point without measurements is that of a flat board: take "
                f"`bend` out of `targets.{target.name}.refine`"
            )
        return residual_of_geometry(candidate)
    try:
        residual = kind.residual(candidate, config, target)
    except RigcalError:
        raise
    except (Exception, SystemExit) as error:
        shapes = ", ".join(f"{k} {np.shape(v)}" for k, v in candidate.measurement.items())
        raise ObservationError(
            f"the residual of sensor type '{kind.name}' cannot be made of its measurements "
            f"({shapes or 'none'}): {type(error).__name__}: {error}"
        ) from error
    try:
        check_rows(residual)
    except ObservationError as error:
        raise ObservationError(
            f"the residual of sensor type '{kind.name}' breaks its contract: {error}; its plugin "
            "needs mending"
        ) from error
    return residual


def residual_of_geometry(candidate: Candidate) -> Residual:
    """The default residual of a candidate, from its geometry and covariance alone."""
    g = candidate.geometry
    match g:
        case PoseGeometry():
            return PoseResidual(g.T_s_t, whitener(g.covariance))
        case PointGeometry():
            return PointResidual(g.target_point, g.position, whitener(g.covariance))
        case PlaneGeometry():
            A = np.zeros((3, 4))
            A[:2, :3] = tangent_basis(g.normal).T @ se3.skew(g.normal)
            A[2] = -np.append(g.center, 1.0)
            return PlaneResidual(whitener(g.covariance) @ A)
    return _line_residual(g)


def _line_residual(g: LineGeometry) -> PlaneResidual:
    """Distance of both end points from the trace of the target's plane in the scan plane z = 0."""
    along = g.end - g.start
    across = np.array([-along[1], along[0], 0.0]) / np.hypot(along[0], along[1])
    N = np.zeros((2, 6))
    N[0, :3] = N[1, 3:] = across
    ends = np.column_stack([np.stack([g.start, g.end]), np.ones(2)])
    ends[:, 2] = 0.0
    return PlaneResidual(whitener(N @ g.covariance @ N.T) @ ends, planar=True)
