"""Scan -> line candidates that could be the board."""

from __future__ import annotations

import numpy as np

from rigcal.geometry.se3 import Array
from rigcal.observation import Candidate, Detection, LineGeometry
from rigcal.ranging import RangeNoise
from rigcal.targets.target import Target
from rigcal_lrf2d.config import Lrf2dConfig
from rigcal_lrf2d.ends import Ends, ends_of
from rigcal_lrf2d.line import Line, fit_line, line_covariance
from rigcal_lrf2d.pieces import Beams, Index, beams_of
from rigcal_lrf2d.scan import Scan
from rigcal_lrf2d.segment import MIN_BEAMS, Segments, straight_segments

MAX_CANDIDATES = 8
_MAX_SIGMA_DIRECTION = 0.1
"""A segment whose direction is known worse than this (rad) says nothing about a plane."""
_Z_VARIANCE = 1e-12


def longest_chord(target: Target) -> float:
    """Greatest distance between two corners of the board, m: no scan line on it is longer."""
    corners = target.outline
    return float(np.linalg.norm(corners[:, None] - corners, axis=-1).max())


def detect(scan: Scan, config: Lrf2dConfig, target: Target) -> Detection:
    """Up to eight straight segments of `scan` that could be the board, the most likely first.

    A segment is a `LineGeometry` in the sensor's frame (z = 0) with the angles (rad) and ranges
    (m) of its beams as measurement. It has at least five beams, is no longer than the board's
    diagonal, and its direction is known to 0.1 rad. Most likely is a segment of a length between
    the board's shorter side and its diagonal that is straight and ends at range jumps to
    something farther away.
    """
    returns = int(np.count_nonzero(scan.valid))
    if returns < MIN_BEAMS:
        reason = f"{returns} of {len(scan.angles)} beams returned a range in the sensor's limits"
        return Detection((), reason)
    scan = scan.cut_at_largest_jump()
    beams, noise = beams_of(scan), config.noise
    longest, short = longest_chord(target), float(target.size.min())
    segments = straight_segments(beams, noise, longest, max_gap=0.1 * short)
    ends = ends_of(segments, beams, scan, noise)
    scores = _scores(segments, ends, beams, noise, short)
    candidates: list[Candidate] = []
    for i in np.argsort(-scores, kind="stable"):
        candidate = candidate_of(segments, ends, int(i), beams, noise, float(scores[i]))
        if candidate is not None:
            candidates.append(candidate)
        if len(candidates) == MAX_CANDIDATES:
            break
    if not candidates:
        reason = (
            f"none of {len(segments)} straight segments among {returns} returns could be the "
            f"board: at least {MIN_BEAMS} beams, at most {longest:.2f} m long, direction known "
            f"to {np.degrees(_MAX_SIGMA_DIRECTION):.0f} deg (sigma_m is {config.sigma_m:g})"
        )
        return Detection((), reason)
    return Detection(tuple(candidates))


def _scores(segments: Segments, ends: Ends, beams: Beams, noise: RangeNoise, short: float) -> Array:
    """(S,) in (0, 1]; `short` is the board's shorter side (m)."""
    z = np.where(segments.members, segments.line.whitened(beams.u, beams.ranges, noise), 0.0)
    count = np.count_nonzero(segments.members, axis=1)
    chi2 = np.sum(z**2, axis=1) / (count - 2)
    edges = np.array([0.2, 0.5, 1.0])[np.count_nonzero(ends.is_edge, axis=1)]
    plausible = (1 + np.minimum(1.0, segments.length / short)) / 2
    result: Array = edges * plausible / np.maximum(1.0, chi2) * count / (count + MIN_BEAMS)
    return result


def candidate_of(
    segments: Segments, ends: Ends, i: int, beams: Beams, noise: RangeNoise, score: float
) -> Candidate | None:
    """Segment i as a candidate; None if it is too short to tell a direction."""
    members = _without_mixed_ends(segments.select(np.array([i])), beams, noise)
    if len(members) < MIN_BEAMS:
        return None
    u, r = beams.u[members], beams.ranges[members]
    line = fit_line(u, r, noise)
    if line is None:
        return None
    covariance = line_covariance(line, u, noise)
    if covariance[0, 0] > _MAX_SIGMA_DIRECTION**2:
        return None
    angles = beams.angles[members]
    geometry = line_geometry(
        line, covariance, angles[[0, -1]], ends.is_edge[i], ends.off[i] * beams.step
    )
    return Candidate(geometry, {"angles": angles, "ranges": r}, score)


def _without_mixed_ends(segment: Segments, beams: Beams, noise: RangeNoise) -> Index:
    """The segment's beams without those at its ends that are off by two standard deviations.

    A beam that half hits the board and half what is behind reports a range in between.
    """
    members = np.flatnonzero(segment.members[0])
    z = segment.line.whitened(beams.u[members], beams.ranges[members], noise)[0]
    good = np.flatnonzero(np.abs(z) < 2)
    return members[good[0] : good[-1] + 1] if len(good) else members[:0]


def line_geometry(
    line: Line, covariance: Array, angles: Array, is_edge: Array, off: Array
) -> LineGeometry:
    """End points on the line, and their covariance (6, 6).

    `angles` (2,) are the last beams on the board; the first ones off it are `off` (2,) rad away.
    An edge lies half-way between, evenly distributed. A turn of the normal moves the point at
    `a` by `a` along the normal per rad, a longer d moves it by -1.
    """
    n, t = np.append(line.normal, 0.0), np.append(line.direction, 0.0)
    at = _along(line, angles)
    gap = np.abs(at - _along(line, angles + np.array([off[0], -off[1]])))
    at = at + np.where(is_edge, np.array([-gap[0], gap[1]]) / 2, 0.0)
    across = np.column_stack([at, -np.ones(2)])
    J = (across[:, None, :] * n[:, None]).reshape(6, 2)
    cov = J @ covariance @ J.T + np.diag([0.0, 0.0, _Z_VARIANCE] * 2)
    cov[:3, :3] += gap[0] ** 2 / 12 * np.outer(t, t)
    cov[3:, 3:] += gap[1] ** 2 / 12 * np.outer(t, t)
    start, end = -line.d * n + at[:, None] * t
    return LineGeometry(start, end, cov, bool(is_edge[0]), bool(is_edge[1]))


def _along(line: Line, angles: Array) -> Array:
    """(N,) where beams meet the line, m from its foot point, in its direction."""
    u = np.column_stack([np.cos(angles), np.sin(angles)])
    result: Array = line.range_of(u) * (u @ line.direction)
    return result
