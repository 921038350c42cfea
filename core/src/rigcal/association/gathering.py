"""The observations of a continuous recording: the frames of each exposure, combined."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcal.association.combine import (
    combine_geometry,
    common_share,
    mean_of,
    nearest_to_mean,
)
from rigcal.association.continuous import (
    MOST_FRAMES,
    Exposure,
    by_sensor,
    sightings_by_sensor,
)
from rigcal.association.rest import BACKGROUND, STILL_M, Sightings
from rigcal.frames import DetectedFrame, Stream
from rigcal.observation import Candidate, Detection, Observation
from rigcal.plugin.answers import check_detection

MOST_CANDIDATES = 8
NO_EXPOSURE = "in motion"
IN_MOTION = "the board moves, or nothing shows that it stands still"
UNSTEADY = "none of its candidates stays in one place for half of the frames"


def still_observations(
    exposures: Sequence[Exposure], streams: Mapping[str, Stream], frames: Sequence[DetectedFrame]
) -> tuple[Observation, ...]:
    """One observation per sensor and exposure, and one for all frames outside of them."""
    sightings = sightings_by_sensor(streams, frames)
    result = []
    for sensor, own in by_sensor(streams, frames).items():
        stamps = np.array([f.stamp.stamp_ns for f in own], dtype=np.int64)
        in_motion = np.ones(len(own), dtype=bool)
        gathered = []
        for exposure in (e for e in exposures if sensor in e.sensors):
            inside = np.flatnonzero((stamps >= exposure.start_ns) & (stamps <= exposure.end_ns))
            in_motion[inside] = False
            if len(inside):
                kept = inside[_spread(len(inside), MOST_FRAMES)]
                foreground = any(len(sightings[sensor].foreground(int(f))) for f in kept)
                groups = _groups(own, kept, sightings[sensor])
                gathered.append(_Gathered(exposure.name, kept, groups, foreground))
        best = [[c.geometry for c in g.groups[0]] for g in gathered if g.groups]
        common = common_share(best)
        result += [_combined(streams[sensor], g, own, common) for g in gathered]
        if in_motion.any():
            result.append(_left_out(sensor, own, np.flatnonzero(in_motion)))
    return tuple(result)


@dataclass(frozen=True, eq=False)
class _Gathered:
    """Frames of a sensor in one exposure, and groups of candidates in one place, best first.

    `has_foreground`: whether any candidate is not background, steady or not.
    """

    exposure: str
    inside: NDArray[np.intp]
    groups: list[list[Candidate]]
    has_foreground: bool


def _spread(count: int, most: int) -> NDArray[np.intp]:
    """At most `most` of `count`, evenly."""
    return np.unique(np.round(np.linspace(0, count - 1, min(count, most))).astype(np.intp))


def _left_out(sensor: str, own: Sequence[DetectedFrame], which: NDArray[np.intp]) -> Observation:
    first = own[which[0]]
    frames = tuple(own[i].stamp.index for i in which)
    return Observation(
        sensor, NO_EXPOSURE, first.stamp.stamp_ns, first.origin, (), IN_MOTION, frames
    )


def _combined(
    stream: Stream, gathered: _Gathered, own: Sequence[DetectedFrame], common: float
) -> Observation:
    """What a sensor saw in one exposure: candidates that stay in it for most of its frames."""
    seen = [own[i] for i in gathered.inside]
    middle = seen[len(seen) // 2]
    candidates, reason = [], ""
    for group in gathered.groups[:MOST_CANDIDATES]:
        try:
            candidates.append(combine(stream, group, common))
        except (Exception, SystemExit) as error:
            reason = f"its frames could not be combined: {type(error).__name__}: {error}"
    if not candidates and not reason:
        reasons = [f.detection.reason for f in seen if f.detection.reason]
        has_some = any(f.detection.candidates for f in seen)
        found = UNSTEADY if gathered.has_foreground else BACKGROUND
        reason = found if has_some else max(reasons, key=reasons.count)
    return Observation(
        stream.sensor,
        gathered.exposure,
        middle.stamp.stamp_ns,
        middle.origin,
        tuple(candidates),
        reason,
        tuple(f.stamp.index for f in seen),
    )


def _groups(
    own: Sequence[DetectedFrame], inside: NDArray[np.intp], sightings: Sightings
) -> list[list[Candidate]]:
    """Candidates of different frames in one place, the best groups first.

    A group spans at least half of the frames that have candidates.
    """
    groups: list[tuple[int, list[Candidate]]] = []
    frames_with_some = 0
    for f in inside:
        found = sightings.foreground(int(f))
        frames_with_some += bool(len(found))
        candidates = own[f].detection.candidates
        if not len(found):
            continue
        anchors = np.array([anchor for anchor, _ in groups], dtype=np.intp)
        same = sightings.places.same(found, anchors, STILL_M)
        taken: set[int] = set()
        for i, c in enumerate(found):
            match = next((g for g in np.flatnonzero(same[i]) if g not in taken), None)
            candidate = candidates[sightings.number[c]]
            if match is None:
                groups.append((int(c), [candidate]))
                taken.add(len(groups) - 1)
            else:
                groups[match][1].append(candidate)
                taken.add(int(match))
    kept = [group for _, group in groups if 2 * len(group) >= frames_with_some]
    return sorted(kept, key=lambda g: (-len(g), -sum(c.score for c in g) / len(g)))


def combine(
    stream: Stream, candidates: Sequence[Candidate], common: float | None = None
) -> Candidate:
    """Candidates of several frames as one, by the sensor type's own way or by geometry.

    `common`: see `mean_of`. ObservationError for an answer that is none.
    """
    if len(candidates) == 1:
        return candidates[0]
    kind, mean = stream.kind, mean_of([c.geometry for c in candidates], common)
    if kind.combine is not None:
        found = kind.combine(candidates, mean, stream.config, stream.target)
        check_detection(Detection((found,)))
        return found
    way = combine_geometry if kind.residual is None else nearest_to_mean
    return way(candidates, mean)
