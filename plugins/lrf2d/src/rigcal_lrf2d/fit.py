"""The candidate of points that another program found on the board."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rigcal.errors import ObservationError
from rigcal.geometry.se3 import Array
from rigcal.observation import Candidate, Detection
from rigcal.targets.target import Target
from rigcal_lrf2d.config import Lrf2dConfig
from rigcal_lrf2d.detector import line_geometry
from rigcal_lrf2d.line import fit_line, line_covariance
from rigcal_lrf2d.scan import directions
from rigcal_lrf2d.segment import MIN_BEAMS


def fit(measured: Mapping[str, Any], config: Lrf2dConfig, target: Target) -> Detection:
    """The line of `points` (N, 2) on the board, or of beams `angles` (N,) rad, `ranges` (N,) m."""
    angles, ranges = _beams(measured)
    if len(angles) < MIN_BEAMS:
        return Detection((), f"{len(angles)} beams on the board, at least {MIN_BEAMS} count")
    u = directions(angles)[:, :2]
    line = fit_line(u, ranges, config.noise)
    if line is None:
        return Detection((), f"{len(angles)} beams, but no line that they do not graze")
    covariance = line_covariance(line, u, config.noise)
    geometry = line_geometry(line, covariance, angles[[0, -1]], np.zeros(2, bool), np.zeros(2))
    return Detection((Candidate(geometry, {"angles": angles, "ranges": ranges}),))


def _beams(measured: Mapping[str, Any]) -> tuple[Array, Array]:
    """Angles (N,) and ranges (N,), in the order of growing angles."""
    arrays = {name: np.asarray(value, np.float64) for name, value in measured.items()}
    if set(arrays) == {"points"} and arrays["points"].ndim == 2:
        x, y = arrays["points"].T[:2]
        arrays = {"angles": np.arctan2(y, x), "ranges": np.hypot(x, y)}
    elif set(arrays) != {"angles", "ranges"}:
        raise ObservationError(
            f"found {', '.join(arrays) or 'nothing'}, expected `points` (N, 2) on the board, or "
            "`angles` (N,) with `ranges` (N,)"
        )
    angles, ranges = arrays["angles"], arrays["ranges"]
    if angles.ndim != 1 or angles.shape != ranges.shape:
        raise ObservationError(
            f"shapes {angles.shape} and {ranges.shape} of angles and ranges, expected (N,) of both"
        )
    if not (np.isfinite(angles).all() and np.isfinite(ranges).all() and (ranges > 0).all()):
        raise ObservationError("angles or ranges are not finite, or a range is not above 0")
    # A board behind the sensor lies across the ends of arctan2.
    middle = np.arctan2(np.sin(angles).sum(), np.cos(angles).sum())
    angles = middle + (angles - middle + np.pi) % (2 * np.pi) - np.pi
    order = np.argsort(angles, kind="stable")
    return angles[order], ranges[order]
