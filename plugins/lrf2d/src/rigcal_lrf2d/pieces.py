"""The returns of a scan, and the straight pieces that they fall into."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry.se3 import Array
from rigcal.ranging import RangeNoise
from rigcal_lrf2d.line import line_of_moments, moments
from rigcal_lrf2d.scan import Scan, directions

Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

_BLOCK = 4
_GRAZING = np.radians(10.0)
_MERGE = 1.5**2 * 13.8
"""Merging two lines of one surface costs chi-square with 2 degrees of freedom, 13.8 once in 1000
times; the configured noise may be too small by half."""


@dataclass(frozen=True, eq=False)
class Beams:
    """The beams of a scan that returned: angles (M,), ranges (M,), directions `u` (M, 2)."""

    angles: Array
    ranges: Array
    u: Array
    step: float

    @cached_property
    def points(self) -> Array:
        """(M, 2)."""
        return self.u * self.ranges[:, None]

    @cached_property
    def moments(self) -> Array:
        """(M, 6), see `line.moments`."""
        return moments(self.points)


def beams_of(scan: Scan) -> Beams:
    """The returns of a scan."""
    angles, ranges = scan.angles[scan.valid], scan.ranges[scan.valid]
    return Beams(angles, ranges, directions(angles)[:, :2], scan.step)


def breakpoints(beams: Beams, noise: RangeNoise) -> Mask:
    """(M,) which beams begin a new surface: the distance to the one before is too great.

    The adaptive threshold of Borges and Aldon, "Line extraction in 2D range images for mobile
    robotics", 2004: a surface may graze the beams at 10 degrees; and three sigma of noise.
    """
    turn = np.minimum(np.diff(beams.angles), _GRAZING / 2)
    nearer = np.minimum(beams.ranges[1:], beams.ranges[:-1])
    allowed = nearer * np.sin(turn) / np.sin(_GRAZING - turn) + 3 * noise.of(nearer)
    jump = np.linalg.norm(np.diff(beams.points, axis=0), axis=1) > allowed
    gap = np.diff(beams.angles) > 8 * beams.step
    return np.concatenate([[True], jump | gap])


def straight_pieces(beams: Beams, noise: RangeNoise) -> tuple[Index, Index]:
    """First beams (K,) and ends (K,), exclusive, of stretches that are straight within the noise.

    Blocks of four beams between breakpoints are merged bottom-up (Keogh et al., "An online
    algorithm for segmenting time series", 2001), all pairs at once that fit better together than
    with their other neighbours, as long as one line explains both.
    """
    is_break = breakpoints(beams, noise)
    count = len(beams.angles)
    runs = np.flatnonzero(is_break)
    position = np.arange(count) - np.repeat(runs, np.diff(np.append(runs, count)))
    starts = np.flatnonzero(position % _BLOCK == 0)
    total = np.vstack([np.zeros(6), np.cumsum(beams.moments, axis=0)])
    while True:
        bounds = np.append(starts, count)
        sums = total[bounds[1:]] - total[bounds[:-1]]
        pairs = sums[:-1] + sums[1:]
        own, both = line_of_moments(sums)[1], line_of_moments(pairs)[1]
        cost = both - own[:-1] - own[1:]
        sigma = noise.of(np.sqrt((pairs[:, 3] + pairs[:, 5]) / pairs[:, 0]))
        cost[is_break[starts[1:]] | (cost > _MERGE * sigma**2)] = np.inf
        beside = np.concatenate([[np.inf], cost, [np.inf]])
        best = np.isfinite(cost) & (cost <= beside[:-2]) & (cost < beside[2:])
        if not best.any():
            return starts, bounds[1:]
        starts = np.delete(starts, np.flatnonzero(best) + 1)
