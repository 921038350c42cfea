"""Image -> candidates for the target's pose, with the corners that it rests on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.errors import ConfigError, ObservationError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.observation import Candidate, Detection, PoseGeometry
from rigcal.plugin.answers import checked_fiducials
from rigcal.targets.target import Target
from rigcal_camera.align import align_corners
from rigcal_camera.chess import find_charuco_corners, find_checkerboard_corners
from rigcal_camera.config import CameraConfig
from rigcal_camera.corners import Corners
from rigcal_camera.frames import Image
from rigcal_camera.lens import Lens, lens_of
from rigcal_camera.pose import PoseFit, fit_poses, refine_pose
from rigcal_camera.tags import find_tag_corners

_CLEARLY_WORSE = 16.0
"""Chi-square by which the second planar pose must lose to be dropped (likelihood e^-8)."""

Finder = Callable[[Image, Target, Lens], Corners]


def detect(image: Image, config: CameraConfig, target: Target) -> Detection:
    """Every pose of the target that explains the corners found in the image.

    Corners are found, then aligned with the print as the best pose shows it (`align_corners`).
    More than one candidate: the pattern looks the same when turned (`target.symmetries`; equal
    scores), or the view does not tell the two poses of a plane apart. `score` is the log-
    likelihood against the best one. `measurement`: `uv` (M, 2) pixels, `index` (M,) into
    `target.points`, `sigma_px` the corner noise estimated from the residual.
    """
    return explain(find_corners(image, target, lens_of(config)), config, target, image)


def fit(measured: Mapping[str, Any], config: CameraConfig, target: Target) -> Detection:
    """The candidates of corners that another program found: `index` (M,), `uv` (M, 2)."""
    if not measured.keys() >= {"index", "uv"}:
        raise ObservationError(
            f"found {', '.join(measured) or 'nothing'}, expected `index` (M,) into the target's "
            "points and `uv` (M, 2) pixels"
        )
    corners = checked_fiducials(target, (measured["index"], measured["uv"]), "it")
    return explain(Corners(*corners), config, target)


def explain(
    corners: Corners, config: CameraConfig, target: Target, image: Image | None = None
) -> Detection:
    """The poses that explain labelled corners, which are aligned with the print in their image."""
    lens = lens_of(config)
    if len(corners) < config.min_corners:
        reason = f"found {len(corners)} corners, min_corners is {config.min_corners}"
        return Detection((), reason=corners.reason or reason)
    first = fit_poses(lens, target.points[corners.index], corners.uv)
    if image is not None and target.find is None and first:
        corners, first = _aligned(image, corners, first, target, lens)
    fits = [(corners.index, fit) for fit in first]
    for labels in target.symmetries:
        index = labels[corners.index]
        fits += [(index, fit) for fit in fit_poses(lens, target.points[index], corners.uv)]
    if not fits:
        return Detection(
            (), reason=f"{len(corners)} corners found, but no pose of '{target.name}' explains them"
        )
    best = min((fit for _, fit in fits), key=lambda fit: fit.sum_of_squares)
    kept = int(best.inliers.sum())
    if kept < max(config.min_corners, len(corners) / 2):
        return Detection(
            (),
            reason=f"the best pose explains only {kept} of {len(corners)} corners "
            f"(min_corners {config.min_corners}, and at least half of them)",
        )
    sigma = max(config.sigma_px, best.sigma_px)
    candidates = []
    for index, fit in fits:
        loss = (fit.sum_of_squares - best.sum_of_squares) / sigma**2
        if loss < _CLEARLY_WORSE and fit.inliers.sum() == kept:
            candidates.append(_candidate(index, corners, fit, config, -0.5 * loss))
    candidates.sort(key=lambda candidate: -candidate.score)
    return Detection(tuple(candidates))


def find_corners(image: Image, target: Target, lens: Lens) -> Corners:
    """The target's labelled corners in an image, as their kind of target is found."""
    if target.find is not None:
        return Corners(*checked_fiducials(target, target.find(image)))
    kind = target.config.type
    if "tag_corners" in target.groups:
        finder: Finder = find_tag_corners
    elif kind == "checkerboard":
        finder = find_checkerboard_corners
    elif kind == "charuco":
        finder = find_charuco_corners
    else:
        raise ConfigError(
            f"target '{target.name}': cameras do not know targets of type '{kind}', and it brings "
            "no `find` of its own (known: apriltag_grid, apriltag_poster, checkerboard, charuco)"
        )
    return finder(image, target, lens)


def _aligned(
    image: Image, corners: Corners, fits: list[PoseFit], target: Target, lens: Lens
) -> tuple[Corners, list[PoseFit]]:
    """The corners where the print as the best of their poses shows it fits the image, and the poses
    that explain them there.

    As they were where that does not make a pose explain the same corners better: motion blur and
    strong compression are not what the print is drawn with.
    """
    p_t, best = target.points[corners.index], fits[0]
    uv = align_corners(image, corners.uv, p_t, target, lens, best.T_s_t)
    after = fit_poses(lens, p_t, uv)
    if not after or np.sum(after[0].errors[best.inliers] ** 2) >= best.sum_of_squares:
        return corners, fits
    return Corners(corners.index, uv), after


def observe(
    T_s_t: Array, config: CameraConfig, target: Target, rng: np.random.Generator
) -> Candidate | None:
    """What a flawless detector reports of a target in plain view, with noise of `sigma_px`.

    None when the camera looks at its back or sees fewer than `min_corners` of its points.
    """
    lens = lens_of(config)
    p_s = se3.apply(T_s_t, target.points)
    index = np.flatnonzero(lens.sees(p_s)).astype(np.int64)
    if len(index) < config.min_corners or se3.inverse(T_s_t)[2, 3] <= 0:
        return None
    uv = lens.pixels_from_points(p_s[index])[0]
    uv = uv + rng.normal(scale=config.sigma_px, size=uv.shape)
    fit = refine_pose(lens, T_s_t, target.points[index], uv)
    if fit is None:
        return None
    return _candidate(index, Corners(index, uv), fit, config, 0.0)


def _candidate(
    index: NDArray[np.int64], corners: Corners, fit: PoseFit, config: CameraConfig, score: float
) -> Candidate:
    covariance = np.asarray(np.linalg.inv(fit.information), np.float64) * config.sigma_px**2
    measurement = {
        "uv": corners.uv[fit.inliers],
        "index": index[fit.inliers],
        "sigma_px": np.array(fit.sigma_px),
    }
    return Candidate(PoseGeometry(fit.T_s_t, covariance), measurement, round(score, 3))
