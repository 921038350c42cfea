"""Reprojection of every detected corner through the camera's own lens."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from rigcal.errors import ObservationError
from rigcal.geometry import se3
from rigcal.geometry.bend import height_by_bend, onto_bend
from rigcal.geometry.se3 import Array
from rigcal.observation import Candidate, PoseGeometry
from rigcal.plugin.contract import Stacked
from rigcal.plugin.refinable import Refined
from rigcal.targets.target import Target
from rigcal_camera.config import CameraConfig
from rigcal_camera.lens import Lens, lens_of
from rigcal_camera.refine import pixels_by_lens, with_values

_UNSEEN_PX = 1e4
"""Error given to a corner behind the camera: finite, and large enough for a step to be undone."""


def reprojection(lens: Lens, T_s_t: Array, p_t: Array, uv: Array) -> tuple[Array, Array]:
    """Errors (N, 2) [px], predicted minus measured, and their derivative (N, 2, 6).

    `T_s_t` is one pose (4, 4), or one for each of the points p_t (N, 3) that are seen at uv (N, 2).
    The derivative is by a right perturbation of `T_s_t`: `p_s = T_s_t p_t`, so
    `dp_s = R (v + w x p_t) = R [-[p_t]x, I] [w, v]`. Points that cannot be imaged have an error of
    10 000 px on both axes and no derivative.
    """
    R, t = T_s_t[..., :3, :3], T_s_t[..., :3, 3]
    predicted, J_point, valid = lens.pixels_from_points(np.einsum("...ij,...j->...i", R, p_t) + t)
    J = np.empty((len(p_t), 2, 6))
    J[..., 3:] = J_point @ R
    # a [p]x = a x p for a row a.
    J[..., :3] = np.cross(p_t[:, None], J[..., 3:])
    return np.where(valid[:, None], predicted - uv, _UNSEEN_PX), J


@dataclass(frozen=True, eq=False)
class ReprojectionResidual:
    """Whitened reprojection errors u0, v0, u1, v1, ... of the corners of one view.

    `common` (2M, 6), if any, is what moves all corners together: the rows are `(I - C C^T) e /
    sigma_px`. With `bends` it is `refined` by the bend of the board too.
    """

    lens: Lens
    p_t: Array
    uv: Array
    sigma_px: float
    common: Array | None = None
    bends: bool = False
    block: int = 2

    @property
    def dof(self) -> int:
        """Two per corner."""
        return 2 * len(self.uv)

    def __call__(self, T_s_t: Array) -> tuple[Array, Array]:
        """R (2M,) and J (2M, 6) at `T_s_t`."""
        return self.stack([self])(T_s_t[None])

    @classmethod
    def stack(cls, residuals: Sequence[Self]) -> Stacked:
        """All views of one camera at once."""
        lens, whiten = residuals[0].lens, _whitener(residuals)
        p_t, uv, view = _all_views(residuals)

        def evaluate(T_s_t: Array) -> tuple[Array, Array]:
            error, J = reprojection(lens, T_s_t[view], p_t, uv)
            rows = whiten(np.column_stack([error.ravel(), J.reshape(-1, 6)]))
            return rows[:, 0], rows[:, 1:]

        return evaluate

    @classmethod
    def refined(cls, residuals: Sequence[Self]) -> Refined:
        """The same as a function of the lens and the board's bend too, as far as asked for."""
        first, whiten = residuals[0], _whitener(residuals)
        p_nominal, uv, view = _all_views(residuals)

        def evaluate(T_s_t: Array, values: Array) -> tuple[Array, Array, Array]:
            of_lens, bend = np.split(values, [len(values) - 3 * first.bends])
            p_t = onto_bend(p_nominal, bend) if first.bends else p_nominal
            lens = with_values(first.lens, of_lens) if len(of_lens) else first.lens
            T = T_s_t[view]
            error, J = reprojection(lens, T, p_t, uv)
            parts = [error.ravel(), J.reshape(-1, 6)]
            if len(of_lens):
                p_s = np.einsum("kij,kj->ki", T[:, :3, :3], p_t) + T[:, :3, 3]
                J_lens = pixels_by_lens(lens, p_s, np.any(J, axis=(1, 2)))
                parts.append(J_lens.reshape(len(p_t) * 2, -1))
            if first.bends:
                # A point that rises moves as by a shift of the board along its z.
                parts.append((J[..., 5:] * height_by_bend(p_t)[:, None]).reshape(-1, 3))
            rows = whiten(np.column_stack(parts))
            return rows[:, 0], rows[:, 1:7], rows[:, 7:]

        return evaluate


def _all_views(
    residuals: Sequence[ReprojectionResidual],
) -> tuple[Array, Array, NDArray[np.intp]]:
    """Points and pixels of all corners, and the view of each."""
    p_t, uv = (np.concatenate([getattr(r, f) for r in residuals]) for f in ("p_t", "uv"))
    view = np.repeat(np.arange(len(residuals)), [len(r.uv) for r in residuals])
    return p_t, uv, view


def _whitener(residuals: Sequence[ReprojectionResidual]) -> Callable[[Array], Array]:
    """Whitens rows (of errors and Jacobians side by side) of all views."""
    dof = [r.dof for r in residuals]
    sigma_px = np.repeat([r.sigma_px for r in residuals], dof)[:, None]
    if all(r.common is None for r in residuals):
        return lambda rows: rows / sigma_px
    C = np.concatenate([np.zeros((r.dof, 6)) if r.common is None else r.common for r in residuals])
    view, starts = np.repeat(np.arange(len(dof)), dof), np.cumsum([0, *dof[:-1]])

    def whiten(rows: Array) -> Array:
        share = np.add.reduceat(C[:, :, None] * rows[:, None, :], starts)
        result: Array = (rows - np.einsum("ri,rij->rj", C, share[view])) / sigma_px
        return result

    return whiten


def make_residual(
    candidate: Candidate, config: CameraConfig, target: Target
) -> ReprojectionResidual:
    """The residual of one candidate, whitened by the camera's `sigma_px`.

    Mean corners of several images have less noise, by their `noise_ratio`; along the six
    directions in which their pose moves them together they have `pose_ratio` times that.
    """
    uv = np.asarray(candidate.measurement["uv"], dtype=np.float64)
    p_t = target.points[np.asarray(candidate.measurement["index"])]
    if p_t.ndim != 2 or uv.shape != (len(p_t), 2) or not len(uv):
        raise ObservationError(
            f"a camera's candidate has `index` of shape {p_t.shape[:-1]} and `uv` of shape "
            f"{uv.shape}; expected (M,) and (M, 2), one row for each corner"
        )
    sigma_px = config.sigma_px * float(candidate.measurement.get("noise_ratio", 1.0))
    lens, ratio = lens_of(config), float(candidate.measurement.get("pose_ratio", 1.0))
    if not ratio >= 1:
        raise ObservationError(f"a camera's candidate has `pose_ratio` {ratio}, expected 1 or more")
    if ratio == 1 or len(uv) < 3 or not isinstance(candidate.geometry, PoseGeometry):
        return ReprojectionResidual(lens, p_t, uv, sigma_px, bends=target.may_bend)
    J = reprojection(lens, candidate.geometry.T_s_t, p_t, uv)[1].reshape(-1, 6)
    # (I - c Q Q^T)^2 is the inverse of I + (ratio^2 - 1) Q Q^T for c = 1 - 1 / ratio.
    common = np.linalg.qr(J)[0] * np.sqrt(1 - 1 / ratio)
    return ReprojectionResidual(lens, p_t, uv, sigma_px, common, target.may_bend)


def errors(candidate: Candidate, config: CameraConfig, target: Target, T_s_t: Array) -> Array:
    """Reprojection errors (M, 2) in pixels, predicted minus measured."""
    residual = make_residual(candidate, config, target)
    return reprojection(residual.lens, T_s_t, residual.p_t, residual.uv)[0]


def measured_at(candidate: Candidate, config: CameraConfig, target: Target, T_s_t: Array) -> Array:
    """Where the detected corners (M, 3) lie in the camera's frame, m."""
    return se3.apply(T_s_t, make_residual(candidate, config, target).p_t)
