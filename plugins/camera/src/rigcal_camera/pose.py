"""The target's pose from labelled corners: PnP through the lens model, both planar solutions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal_camera.lens import Lens
from rigcal_camera.residual import reprojection

_RANSAC_PX = 4.0
_MIN_OUTLIER_PX = 0.5
_OUTLIER_SIGMAS = 5.0
_STEPS = 30
_MIN_RAY_Z = 0.1
_SAME_POSE = 1e-3


@dataclass(frozen=True, eq=False)
class PoseFit:
    """A local minimum of the reprojection error.

    `T_s_t` (4, 4), `errors` (N, 2) [px] of all corners given, `inliers` (N,) those it was fitted
    to, `information` (6, 6) = J^T J for a corner noise of 1 px.
    """

    T_s_t: Array
    errors: Array
    inliers: NDArray[np.bool_]
    information: Array

    @property
    def sum_of_squares(self) -> float:
        """Of the inliers' errors, px^2."""
        return float(np.sum(self.errors[self.inliers] ** 2))

    @property
    def sigma_px(self) -> float:
        """Corner noise per axis estimated from the inliers' residuals, 6 parameters deducted."""
        dof = max(2 * int(self.inliers.sum()) - 6, 1)
        return float(np.sqrt(self.sum_of_squares / dof))


def fit_poses(lens: Lens, p_t: Array, uv: Array) -> list[PoseFit]:
    """Poses of the planar target that explain corners `uv` (N, 2) of points `p_t` (N, 3).

    Mislabelled corners are found by RANSAC over homographies of the undistorted rays, then by
    their reprojection error. A planar target has two poses that look nearly alike (Schweighofer &
    Pinz 2006; IPPE, Collins & Bartoli 2014): both are refined on the same inliers, the better one
    comes first, and one that does not show the printed face to the camera is dropped. Empty when no
    pose explains at least 4 corners.
    """
    consistent = homography_inliers(lens, p_t, uv)
    if consistent.sum() < 4:
        return []
    fits: list[PoseFit] = []
    for T in _planar_poses(lens, p_t[consistent], uv[consistent]):
        fit = refine_pose(lens, T, p_t, uv, consistent)
        if fit is not None and not any(_same(fit, other) for other in fits):
            fits.append(fit)
    fits.sort(key=lambda fit: fit.sum_of_squares)
    if not fits:
        return []
    inliers = _explained(fits[0])
    if inliers.sum() < 4:
        return []
    refits = [refine_pose(lens, fit.T_s_t, p_t, uv, inliers) for fit in fits]
    return sorted((fit for fit in refits if fit is not None), key=lambda fit: fit.sum_of_squares)


def normalised(lens: Lens, uv: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Undistorted image points x/z, y/z (N, 2), and which are usable (well in front) (N,)."""
    rays = lens.rays_from_pixels(uv)
    usable = np.nan_to_num(rays[:, 2]) > _MIN_RAY_Z
    z = np.where(usable, rays[:, 2], 1.0)
    return np.where(usable[:, None], rays[:, :2] / z[:, None], 0.0), usable


def homography_inliers(
    lens: Lens, p_t: Array, uv: Array, iterations: int = 500
) -> NDArray[np.bool_]:
    """Which corners (N,) agree on one homography from the target to the undistorted image."""
    import cv2

    xy, usable = normalised(lens, uv)
    if usable.sum() < 4:
        return np.zeros(len(uv), dtype=bool)
    threshold = _RANSAC_PX / min(lens.focal)
    _, mask = cv2.findHomography(
        np.ascontiguousarray(p_t[usable, :2]),
        xy[usable],
        cv2.RANSAC,
        threshold,
        maxIters=iterations,
    )
    inliers = usable.copy()
    inliers[usable] = False if mask is None else mask.ravel().astype(bool)
    return inliers


def _planar_poses(lens: Lens, p_t: Array, uv: Array) -> list[Array]:
    """The two IPPE poses, those with the printed face towards the camera."""
    import cv2

    xy, _ = normalised(lens, uv)
    centre = p_t.mean(axis=0)
    try:
        _, rotations, translations, _ = cv2.solvePnPGeneric(
            np.ascontiguousarray(p_t - centre), xy, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
        )
    except cv2.error:
        return []
    poses = []
    for rotation, translation in zip(rotations, translations, strict=True):
        R = se3.exp_so3(np.asarray(rotation, dtype=np.float64).ravel())
        T = se3.transform(R, np.asarray(translation, dtype=np.float64).ravel() - R @ centre)
        if np.isfinite(T).all():
            poses.append(T)
    return poses


def _faces_camera(T_s_t: Array) -> bool:
    """Whether the camera stands on the side of the target that its z axis points to."""
    return bool(se3.inverse(T_s_t)[2, 3] > 0)


def refine_pose(
    lens: Lens, T: Array, p_t: Array, uv: Array, inliers: NDArray[np.bool_] | None = None
) -> PoseFit | None:
    """Levenberg-Marquardt on the reprojection errors of the inliers (N,) (None: of all), from T.

    None when the minimum shows the target's back, or leaves some direction open.
    """
    if inliers is None:
        inliers = np.ones(len(uv), dtype=bool)
    points, pixels = p_t[inliers], uv[inliers]
    error, J = reprojection(lens, T, points, pixels)
    cost, damping = float(np.sum(error**2)), 1e-6
    for _ in range(_STEPS):
        A = J.reshape(-1, 6)
        H, g = A.T @ A, A.T @ error.ravel()
        try:
            step = np.asarray(np.linalg.solve(H + damping * np.diag(np.diag(H)), -g), np.float64)
        except np.linalg.LinAlgError:
            return None
        moved = T @ se3.exp(step)
        new_error, new_J = reprojection(lens, moved, points, pixels)
        new_cost = float(np.sum(new_error**2))
        if new_cost <= cost:
            done = cost - new_cost <= 1e-10 * cost
            T, error, J, cost, damping = moved, new_error, new_J, new_cost, damping * 0.1
            if done:
                break
        elif damping > 1e6:
            break
        else:
            damping = max(damping, 1e-7) * 10
    A = J.reshape(-1, 6)
    information = A.T @ A
    if not _faces_camera(T) or np.linalg.matrix_rank(information, hermitian=True) < 6:
        return None
    return PoseFit(T, reprojection(lens, T, p_t, uv)[0], inliers, information)


def _explained(fit: PoseFit) -> NDArray[np.bool_]:
    """Corners whose error is no outlier, judged by the robust spread of the others."""
    distance = np.linalg.norm(fit.errors, axis=1)
    # The median of a Rayleigh distribution is 1.1774 sigma.
    spread = float(np.median(distance[fit.inliers])) / 1.1774
    result: NDArray[np.bool_] = distance < max(_OUTLIER_SIGMAS * spread, _MIN_OUTLIER_PX)
    return result


def _same(a: PoseFit, b: PoseFit) -> bool:
    difference = se3.log(se3.inverse(a.T_s_t) @ b.T_s_t)
    scale = np.linalg.norm(a.T_s_t[:3, 3])
    return bool(
        np.linalg.norm(difference[:3]) + np.linalg.norm(difference[3:]) / scale < _SAME_POSE
    )
