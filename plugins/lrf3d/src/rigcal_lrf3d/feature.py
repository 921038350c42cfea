"""What a flawless detector reports: the features of experiments without clouds of a whole room."""

from __future__ import annotations

import numpy as np

from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import plane_of_target
from rigcal.observation import Candidate, PlaneGeometry
from rigcal.scene import Scene
from rigcal.targets.target import Target
from rigcal_lrf3d import plane
from rigcal_lrf3d.config import Lrf3dConfig
from rigcal_lrf3d.segment import Scales
from rigcal_lrf3d.simulator import simulate

_MIN_POINTS = 20


def observe(
    T_s_t: Array, config: Lrf3dConfig, target: Target, rng: np.random.Generator
) -> Candidate | None:
    """The plane of all returns of a target at `T_s_t` with nothing else around it.

    None if fewer than 20 beams hit it, or if they see its back.
    """
    n, d = plane_of_target(T_s_t)
    points = simulate(np.eye(4), Scene(target, T_s_t), config, rng).points
    if d <= 0 or len(points) < _MIN_POINTS:
        return None
    cell = Scales.of(target.size, config.noise).voxel
    fitted = plane.fit(points, n, float(d), config.noise, cell)
    if fitted is None:
        return None
    geometry = PlaneGeometry(fitted.normal, fitted.d, fitted.center, fitted.covariance)
    return Candidate(geometry, {"points": points[fitted.inliers]}, 1.0)
