"""Straight segments of a scan: lines grown from its straight pieces.

Split-and-merge alone cuts a board where one beam is odd, and runs on where a body adjoins it. So
each piece is a seed only: a line is fitted to it, extended over the stretch of beams that most
likely belongs to it, and fitted again until nothing changes. All seeds grow at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.geometry.se3 import Array
from rigcal.ranging import RangeNoise
from rigcal_lrf2d.line import Line, line_of_moments
from rigcal_lrf2d.pieces import Beams, Index, Mask, straight_pieces

MIN_BEAMS = 5
_GATE = 3.5
"""Whitened residual at which a beam is as likely to lie on the line as not."""
_ROUNDS = 6


@dataclass(frozen=True, eq=False)
class Segments:
    """S lines and their beams: `first` and `last` (S,), and `members` (S, M) which between."""

    line: Line
    members: Mask
    first: Index
    last: Index
    length: Array

    def __len__(self) -> int:
        return len(self.first)

    def select(self, which: Mask | Index) -> Segments:
        """Some of them."""
        line = Line(self.line.normal[which], self.line.d[which])
        first, last, length = self.first[which], self.last[which], self.length[which]
        return Segments(line, self.members[which], first, last, length)


def straight_segments(
    beams: Beams, noise: RangeNoise, max_length: float, max_gap: float
) -> Segments:
    """Segments of at most `max_length` (m) and at least `MIN_BEAMS` beams, in scan order.

    Noise may lengthen them by three sigma. What goes on straight for longer (a wall) is left out.
    A segment bridges places without inliers up to `max_gap` (m). Segments may overlap where two
    lines explain the same beams.
    """
    starts, ends = straight_pieces(beams, noise)
    size = np.linalg.norm(beams.points[ends - 1] - beams.points[starts], axis=1)
    longest = max_length + 3 * noise.of(beams.ranges)
    seeds = (ends - starts >= MIN_BEAMS) & (size <= longest[starts])
    index = np.arange(len(beams.angles))
    members = (index >= starts[seeds, None]) & (index < ends[seeds, None])
    members = _grown(beams, members, noise, max_gap)
    members = _distinct(members[np.count_nonzero(members, axis=1) >= MIN_BEAMS])
    segments = segments_of(beams, members)
    return segments.select(segments.length <= longest[segments.first])


def segments_of(beams: Beams, members: Mask) -> Segments:
    """Lines, ends and lengths (m, along the line) of sets of beams (S, M)."""
    line = line_of_moments(members @ beams.moments)[0]
    first = np.argmax(members, axis=1)
    last = members.shape[1] - 1 - np.argmax(members[:, ::-1], axis=1)
    chord = beams.points[last] - beams.points[first]
    length = np.abs(np.einsum("si,si->s", chord, line.direction))
    return Segments(line, members, first, last, length)


def _distinct(members: Mask) -> Mask:
    """Without repetitions, in scan order."""
    if len(members) == 0:
        return members
    ends = np.column_stack([members.argmax(axis=1), -members[:, ::-1].argmax(axis=1)])
    return members[np.unique(ends, axis=0, return_index=True)[1]]


def _grown(beams: Beams, members: Mask, noise: RangeNoise, max_gap: float) -> Mask:
    """Seeds (S, M) after growing; those that lose their beams have none."""
    members = members.copy()
    active = np.arange(len(members))
    for _ in range(_ROUNDS):
        grown = _extended(beams, members[active], noise, max_gap)
        changed = np.any(grown != members[active], axis=1)
        members[active] = grown
        alive = np.count_nonzero(grown, axis=1) >= MIN_BEAMS
        active = active[changed & alive]
        if len(active) == 0:
            break
    return members


def _extended(beams: Beams, members: Mask, noise: RangeNoise, max_gap: float) -> Mask:
    """(S, M): the inliers in the most likely stretch of beams around the middle of each set.

    A beam on the line has a normal residual, any other a uniform one, so that its log likelihood
    ratio is (GATE^2 - z^2) / 2, limited below. The stretch maximises the sum.
    """
    line = line_of_moments(members @ beams.moments)[0]
    z = np.abs(line.whitened(beams.u, beams.ranges, noise))
    on_line = z < _GATE
    index = np.arange(members.shape[1])
    count = np.cumsum(members, axis=1)
    middle = np.argmax(count > count[:, -1:] // 2, axis=1)[:, None]
    run = np.cumsum(on_line & _after_gap(beams, line, on_line, max_gap), axis=1)
    here = run == np.take_along_axis(run, middle, axis=1)
    gain = np.where(here, np.clip((_GATE**2 - z**2) / 2, -_GATE, _GATE), -1e6)
    total = np.cumsum(gain, axis=1)
    end = np.argmax(np.where(index >= middle, total, -np.inf), axis=1)[:, None]
    begin = np.argmin(np.where(index <= middle, total - gain, np.inf), axis=1)[:, None]
    result: Mask = on_line & (index >= begin) & (index <= end)
    return result


def _after_gap(beams: Beams, line: Line, on_line: Mask, max_gap: float) -> Mask:
    """(S, M) which beams are farther than `max_gap` (m, along the line) from the inlier before."""
    seen = np.maximum.accumulate(np.where(on_line, np.arange(on_line.shape[1]), 0), axis=1)
    before = np.concatenate([seen[:, :1], seen[:, :-1]], axis=1)
    bridged = max_gap * np.abs(line.incidence(beams.u)) / beams.ranges
    result: Mask = beams.angles - beams.angles[before] > np.maximum(2.5 * beams.step, bridged)
    return result
