"""Reprojection of every detected corner through the camera's own lens."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from rigcal.errors import ObservationError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.observation import Candidate
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
    J_translation = J_point @ R
    J = np.concatenate([-J_translation @ se3.skew(p_t), J_translation], axis=2)
    return np.where(valid[:, None], predicted - uv, _UNSEEN_PX), J


@dataclass(frozen=True, eq=False)
class ReprojectionResidual:
    """Whitened reprojection errors u0, v0, u1, v1, ... of the corners of one view."""

    lens: Lens
    p_t: Array
    uv: Array
    sigma_px: float
    block: int = 2

    @property
    def dof(self) -> int:
        """Two per corner."""
        return 2 * len(self.uv)

    def __call__(self, T_s_t: Array) -> tuple[Array, Array]:
        """R (2M,) and J (2M, 6) at `T_s_t`."""
        error, J = reprojection(self.lens, T_s_t, self.p_t, self.uv)
        return error.ravel() / self.sigma_px, J.reshape(-1, 6) / self.sigma_px

    @classmethod
    def stack(cls, residuals: Sequence[Self]) -> Stacked:
        """All views of one camera at once."""
        first = residuals[0]
        p_t, uv = (np.concatenate([getattr(r, f) for r in residuals]) for f in ("p_t", "uv"))
        view = np.repeat(np.arange(len(residuals)), [len(r.uv) for r in residuals])

        def evaluate(T_s_t: Array) -> tuple[Array, Array]:
            error, J = reprojection(first.lens, T_s_t[view], p_t, uv)
            return error.ravel() / first.sigma_px, J.reshape(-1, 6) / first.sigma_px

        return evaluate

    @classmethod
    def refined(cls, residuals: Sequence[Self]) -> Refined:
        """The same as a function of the lens too."""
        first = residuals[0]
        p_t, uv = (np.concatenate([getattr(r, f) for r in residuals]) for f in ("p_t", "uv"))
        view = np.repeat(np.arange(len(residuals)), [len(r.uv) for r in residuals])

        def evaluate(T_s_t: Array, values: Array) -> tuple[Array, Array, Array]:
            lens, T = with_values(first.lens, values), T_s_t[view]
            error, J = reprojection(lens, T, p_t, uv)
            p_s = np.einsum("kij,kj->ki", T[:, :3, :3], p_t) + T[:, :3, 3]
            J_lens = pixels_by_lens(lens, p_s, np.any(J, axis=(1, 2))).reshape(len(p_t) * 2, -1)
            rows = error.ravel(), J.reshape(-1, 6), J_lens
            r, J, J_lens = (part / first.sigma_px for part in rows)
            return r, J, J_lens

        return evaluate


def make_residual(
    candidate: Candidate, config: CameraConfig, target: Target
) -> ReprojectionResidual:
    """The residual of one candidate, whitened by the camera's `sigma_px`."""
    uv = np.asarray(candidate.measurement["uv"], dtype=np.float64)
    p_t = target.points[np.asarray(candidate.measurement["index"])]
    if p_t.ndim != 2 or uv.shape != (len(p_t), 2) or not len(uv):
        raise ObservationError(
            f"a camera's candidate has `index` of shape {p_t.shape[:-1]} and `uv` of shape "
            f"{uv.shape}; expected (M,) and (M, 2), one row for each corner"
        )
    return ReprojectionResidual(lens_of(config), p_t, uv, config.sigma_px)


def errors(candidate: Candidate, config: CameraConfig, target: Target, T_s_t: Array) -> Array:
    """Reprojection errors (M, 2) in pixels, predicted minus measured."""
    residual = make_residual(candidate, config, target)
    return reprojection(residual.lens, T_s_t, residual.p_t, residual.uv)[0]
