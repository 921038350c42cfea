"""Candidates of points that are known to be on the board: simulated ones, or found by others."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rigcal.errors import ObservationError
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import fit_plane, plane_of_target
from rigcal.observation import Candidate, Detection, PlaneGeometry
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
    return _candidate(points, n, float(d), config, target)


def fit(measured: Mapping[str, Any], config: Lrf3dConfig, target: Target) -> Detection:
    """The plane of `points` (N, 3) on the board, in the sensor's frame, as another program found.

    Stray points are left out.
    """
    points = np.asarray(measured.get("points", ()), np.float64)
    if set(measured) != {"points"} or points.ndim != 2 or points.shape[1] != 3:
        raise ObservationError(
            f"found {', '.join(measured) or 'nothing'}, expected `points` (N, 3) on the board"
        )
    if not np.isfinite(points).all():
        raise ObservationError("`points` holds a value that is not finite")
    at_origin = int(np.count_nonzero(~points.any(axis=1)))
    if at_origin:
        raise ObservationError(
            f"{at_origin} of {len(points)} `points` lie at the sensor's origin, where nothing can "
            "be on the board: leave missing returns out"
        )
    if len(points) < _MIN_POINTS:
        return Detection((), f"{len(points)} points on the board, at least {_MIN_POINTS} count")
    n, d = fit_plane(points)
    found = _candidate(points, n, d, config, target)
    if found is None:
        return Detection((), f"{len(points)} points, but no plane within the noise of `sigma_m`")
    return Detection((found,))


def _candidate(
    points: Array, n: Array, d: float, config: Lrf3dConfig, target: Target
) -> Candidate | None:
    cell = Scales.of(target.size, config.noise).voxel
    fitted = plane.fit(points, n, d, config.noise, cell)
    if fitted is None:
        return None
    geometry = PlaneGeometry(fitted.normal, fitted.d, fitted.center, fitted.covariance)
    return Candidate(geometry, {"points": points[fitted.inliers]}, 1.0)
