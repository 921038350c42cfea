"""Exposures of a continuous recording: when the sensors that see the board see it at rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rigcal.association.rest import Rest, Sightings, rests
from rigcal.geometry.se3 import Array

Interval = tuple[float, float]

_LINK = 0.5
_COVERED = 0.2
_MARGIN_S = 0.02
_LEAST_EXPOSURES = 3
_LEAST_SHARE = 0.1


def still_intervals(sightings: Sequence[Sightings], hold_s: float) -> list[Interval]:
    """(start, end) in s of the exposures, in order, for sensors that look at one target.

    Rests that are certain come first, long ones before short ones. Rests of other sensors that
    share most of their time with one are the same exposure; it lasts as long as all certain ones of
    them do, or else all.
    Surfaces alone (a wall that somebody half hides, somebody who stands still) make an exposure
    only where two sensors agree, and no sensor that is certain sees the board move.
    """
    found = [r for s in sightings for r in rests(s, hold_s)]
    moving = _moving(sightings, [r for r in found if r.certain])
    accepted: list[Interval] = []
    for seed in sorted(found, key=lambda r: (not r.certain, -r.length_s, r.start_s, r.sensor)):
        if any(_shared(seed, a) > _COVERED * seed.length_s for a in accepted):
            continue
        linked = _linked(seed, found)
        if not seed.certain and not linked:
            continue
        together = [r for r in (seed, *linked) if r.certain] or [seed, *linked]
        start = max(r.start_s for r in together) + _MARGIN_S
        end = min(r.end_s for r in together) - _MARGIN_S
        contradicts = np.count_nonzero((moving > start) & (moving < end)) >= 2
        if end - start < 0.5 * hold_s or (contradicts and not seed.certain):
            continue
        accepted.append((start, end))
    return sorted(accepted)


def is_held(intervals: Sequence[Interval], sightings: Sequence[Sightings]) -> bool:
    """Whether a recording is one of a board held still: often enough, and for long enough."""
    times = np.concatenate([s.times_s for s in sightings]) if sightings else np.zeros(0)
    if len(intervals) < _LEAST_EXPOSURES or not len(times):
        return False
    return sum(end - start for start, end in intervals) > _LEAST_SHARE * float(np.ptp(times))


def _moving(sightings: Sequence[Sightings], certain: Sequence[Rest]) -> Array:
    """Times (s) at which a sensor sees the target itself, and not at rest."""
    by_sensor: Mapping[str, list[Rest]] = {s.sensor: [] for s in sightings}
    for rest in certain:
        by_sensor[rest.sensor].append(rest)
    times = []
    for one in sightings:
        own = np.unique(one.frame[one.places.is_pose])
        t = one.times_s[own]
        at_rest = np.zeros(len(t), dtype=bool)
        for rest in by_sensor[one.sensor]:
            at_rest |= (t >= rest.start_s) & (t <= rest.end_s)
        times.append(t[~at_rest])
    return np.concatenate(times) if times else np.zeros(0)


def _shared(rest: Rest, other: Interval) -> float:
    return max(0.0, min(rest.end_s, other[1]) - max(rest.start_s, other[0]))


def _linked(seed: Rest, found: Sequence[Rest]) -> list[Rest]:
    """Of every other sensor the rest that shares most time with the seed, if it shares half."""
    best: dict[str, tuple[float, Rest]] = {}
    for rest in found:
        if rest.sensor == seed.sensor:
            continue
        both = _shared(rest, (seed.start_s, seed.end_s))
        share = both / (rest.length_s + seed.length_s - both)
        if share >= _LINK and share > best.get(rest.sensor, (0.0, rest))[0]:
            best[rest.sensor] = share, rest
    return [rest for _, rest in best.values()]
