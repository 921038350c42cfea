"""A second look at a cloud, where the board must be."""

from __future__ import annotations

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import inside_convex, plane_of_target
from rigcal.observation import Candidate, Detection, PlaneGeometry
from rigcal.targets.target import Target
from rigcal_lrf3d import plane
from rigcal_lrf3d.cloud import Cloud
from rigcal_lrf3d.config import Lrf3dConfig
from rigcal_lrf3d.segment import Scales

_GATE_M = 0.05
_LEAST_POINTS = 12
_LEAST_SPREAD = 0.15
_LEAST_SHARE = 0.5


def near(cloud: Cloud, config: Lrf3dConfig, target: Target, T_s_t: Array) -> Detection:
    """The plane of the returns along beams that should hit the board, from near it; or a reason.

    Half of the returns at least must come from near it, and they must spread over the board.
    Unlike a candidate of `detect` it may be part of a larger surface: the board leans on a wall.
    """
    scales = Scales.of(target.size, config.noise)
    n, distance = plane_of_target(T_s_t)
    d = float(distance)
    if d < scales.reach:
        return Detection((), "the board is seen edge-on where it must be")
    towards = cloud.points[cloud.points @ n < -0.05 * np.linalg.norm(cloud.points, axis=1)]
    p_t = se3.apply(se3.inverse(T_s_t), plane.beam_feet(towards, n, d))[:, :2]
    on_board = towards[inside_convex(p_t, target.outline, margin=-scales.edge)]
    gate = _GATE_M + 3.5 * config.noise.of(np.linalg.norm(on_board, axis=1))
    close = on_board[np.abs(on_board @ n + d) < gate]
    if len(close) < max(_LEAST_POINTS, _LEAST_SHARE * len(on_board)):
        reason = f"{len(close)} of {len(on_board)} returns along its beams come from near the board"
        return Detection((), reason)
    first_n, first_d = plane.coarse(close, float(gate.max()))
    fitted = plane.fit(close, first_n, first_d, config.noise, scales.voxel)
    if fitted is None or fitted.inliers.sum() < _LEAST_POINTS:
        return Detection((), "the returns near the board make no plane")
    inliers = close[fitted.inliers]
    spread = np.sqrt(np.linalg.eigvalsh(np.cov((inliers - inliers.mean(axis=0)).T))[1])
    if spread < _LEAST_SPREAD * scales.short:
        return Detection((), "the returns near the board lie on a line")
    geometry = PlaneGeometry(fitted.normal, fitted.d, fitted.center, fitted.covariance)
    return Detection((Candidate(geometry, {"points": inliers.astype(np.float32)}, 0.0),))
