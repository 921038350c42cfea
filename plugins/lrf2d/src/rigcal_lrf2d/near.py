"""A second look at a scan, where the board must be."""

from __future__ import annotations

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import inside_convex, plane_of_target
from rigcal.observation import Detection
from rigcal.targets.target import Target
from rigcal_lrf2d.config import Lrf2dConfig
from rigcal_lrf2d.detector import candidate_of
from rigcal_lrf2d.ends import ends_of
from rigcal_lrf2d.line import Line
from rigcal_lrf2d.pieces import Beams, Mask, beams_of
from rigcal_lrf2d.scan import Scan, directions
from rigcal_lrf2d.segment import MIN_BEAMS, segments_of

_GATE_M = 0.05
_ON_LINE = 3.5
_ROUNDS = 4


def near(scan: Scan, config: Lrf2dConfig, target: Target, T_s_t: Array) -> Detection:
    """The segment of the beams that should hit the board and return from near it, or a reason.

    Half of these beams at least must return from one line. Unlike a candidate of `detect` it may
    be part of a longer straight piece: a wall that the board leans against.
    """
    if len(scan.angles) < MIN_BEAMS or np.count_nonzero(scan.valid) < MIN_BEAMS:
        return Detection((), "the scan has too few returns")
    scan = scan.cut_at_largest_jump()
    beams, noise = beams_of(scan), config.noise
    n, d = plane_of_target(T_s_t)
    across = float(np.hypot(n[0], n[1]))
    expected = _line(n, float(d), across)
    if expected is None:
        return Detection((), "the board is seen edge-on where it must be")
    on_board = _beams_on_board(beams, expected, T_s_t, target)
    error = np.abs(beams.ranges - expected.range_of(beams.u))
    members = on_board & (error * across < _GATE_M + _ON_LINE * noise.of(beams.ranges))
    for _ in range(_ROUNDS):
        if np.count_nonzero(members) < max(MIN_BEAMS, np.count_nonzero(on_board) / 2):
            return Detection(
                (),
                f"{np.count_nonzero(members)} of {np.count_nonzero(on_board)} beams that should "
                "hit the board return from near it",
            )
        line = segments_of(beams, members[None]).line
        z = np.abs(line.whitened(beams.u, beams.ranges, noise)[0])
        kept: Mask = on_board & (z < _ON_LINE)
        if np.array_equal(kept, members):
            break
        members = kept
    segments = segments_of(beams, members[None])
    candidate = candidate_of(segments, ends_of(segments, beams, scan, noise), 0, beams, noise, 0.0)
    if candidate is None:
        return Detection((), "the beams near the board make no line")
    return Detection((candidate,))


def _line(n: Array, d: float, across: float) -> Line | None:
    """The trace of the board's plane in the scan's plane."""
    if across < 0.1 or d <= 0:
        return None
    return Line(n[:2] / across, np.asarray(d / across))


def _beams_on_board(beams: Beams, line: Line, T_s_t: Array, target: Target) -> Mask:
    """(M,) which beams should hit the board."""
    ranges = line.range_of(beams.u)
    meets = np.isfinite(ranges)
    p_s = directions(beams.angles) * np.where(meets, ranges, 0.0)[:, None]
    p_t = se3.apply(se3.inverse(T_s_t), p_s)[:, :2]
    result: Mask = meets & inside_convex(p_t, target.outline)
    return result
