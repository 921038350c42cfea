"""Where segments end, and whether the board does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.geometry.se3 import Array
from rigcal.ranging import RangeNoise
from rigcal_lrf2d.line import Line
from rigcal_lrf2d.pieces import Beams, Mask
from rigcal_lrf2d.scan import Scan
from rigcal_lrf2d.segment import Segments

_JUMP = 5.0
"""A range jump, in standard deviations."""
_AHEAD = np.arange(1, 4)


@dataclass(frozen=True, eq=False)
class Ends:
    """Both ends (S, 2) of S segments: whether the board ends there, and how many beams farther
    the first one off it lies (1, or 2 if a mixed pixel is between).
    """

    is_edge: Mask
    off: Array


def ends_of(segments: Segments, beams: Beams, scan: Scan, noise: RangeNoise) -> Ends:
    """The ends towards smaller and greater angles.

    An end is an edge of the board if the next beam (or the next but one: a mixed pixel lies
    between) goes on behind the line or finds nothing, and none of the next three is in front of
    it. At the end of the scan nothing is known: no edge.
    """
    last = np.stack([segments.first, segments.last], axis=1)
    ahead = beams.angles[last][..., None] + beams.step * np.array([[-1.0], [1.0]]) * _AHEAD
    ranges = ranges_near(ahead, beams, scan)
    u = np.stack([np.cos(ahead), np.sin(ahead)], axis=-1)
    line = Line(segments.line.normal[:, None], segments.line.d[:, None])
    # A beam that never meets the line may still meet what stands in front of its end.
    predicted = np.minimum(line.range_of(u), 2 * beams.ranges[last][..., None])
    z = (ranges - predicted) / line.sigma(u, noise)
    behind, hidden = z[..., :2] > _JUMP, np.any(z < -_JUMP, axis=-1)
    is_edge = np.any(behind, axis=-1) & ~hidden & ~np.isnan(ranges[..., 0])
    return Ends(is_edge, np.where(behind[..., 0], 1.0, 2.0))


def ranges_near(angles: Array, beams: Beams, scan: Scan) -> Array:
    """Ranges of the beams nearest to `angles`, same shape; inf: no return, NaN: off the scan."""
    low, high = scan.angles[0] - beams.step / 2, scan.angles[-1] + beams.step / 2
    outside = (angles < low) | (angles > high)
    if scan.is_full_circle:
        angles = low + (angles - low) % (2 * np.pi)
        outside = np.zeros(angles.shape, dtype=bool)
    after = np.clip(np.searchsorted(beams.angles, angles), 1, len(beams.angles) - 1)
    nearest = after - (angles - beams.angles[after - 1] < beams.angles[after] - angles)
    seen = np.abs(beams.angles[nearest] - angles) < 0.6 * beams.step
    result: Array = np.where(outside, np.nan, np.where(seen, beams.ranges[nearest], np.inf))
    return result
