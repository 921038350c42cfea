"""The corners of several images of a board that stands still, as one candidate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigcal.observation import Candidate, MeanGeometry, PoseGeometry
from rigcal.targets.target import Target
from rigcal_camera.config import CameraConfig
from rigcal_camera.lens import lens_of
from rigcal_camera.pose import refine_pose


def combine(
    candidates: Sequence[Candidate], mean: MeanGeometry, config: CameraConfig, target: Target
) -> Candidate:
    """The mean pixels of the corners that half of the images show, and their pose.

    What remains of the residuals of the mean corners tells the corner noise that the images share
    (the place of the pixels) from what averages out: `noise_ratio` is the corner noise over that
    of one image. Where the poses of the images scatter by more than corner noise, the board
    trembles, and what is left of that moves all corners together: `pose_ratio` is the deviation of
    the mean pose over what corner noise alone makes of it.
    """
    index = np.concatenate([np.asarray(c.measurement["index"]) for c in candidates])
    uv = np.concatenate([np.asarray(c.measurement["uv"]) for c in candidates])
    corners, place, count = np.unique(index, return_inverse=True, return_counts=True)
    sums = np.column_stack([np.bincount(place, column) for column in uv.T])
    kept = 2 * count >= len(candidates)
    corners, uv = corners[kept], (sums / count[:, None])[kept]
    assert isinstance(mean.geometry, PoseGeometry)
    fit = refine_pose(lens_of(config), mean.geometry.T_s_t, target.points[corners], uv)
    if fit is None:
        return max(candidates, key=lambda c: c.score)
    single_px = float(np.mean([float(c.measurement["sigma_px"]) for c in candidates]))
    N = len(candidates)
    variance = float(np.clip((fit.sigma_px / single_px) ** 2, 1 / N, 1.0))
    corner_scatter = (1 - variance) * N / (N - 1)
    tremor = max(mean.scatter * (config.sigma_px / single_px) ** 2 - corner_scatter, 0.0) / N
    covariance = np.asarray(np.linalg.inv(fit.information), np.float64)
    covariance *= config.sigma_px**2 * mean.variance_ratio
    measurement = {
        "uv": uv,
        "index": corners,
        "sigma_px": np.array(fit.sigma_px),
        "noise_ratio": np.array(np.sqrt(variance)),
        "pose_ratio": np.array(np.sqrt(1 + tremor / variance)),
    }
    score = float(np.mean([c.score for c in candidates]))
    return Candidate(PoseGeometry(fit.T_s_t, covariance), measurement, score)
