"""A second look at frames in which a sensor missed the target, near where it must be."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from rigcal.association.gathering import combine
from rigcal.association.place import places_of
from rigcal.association.rest import STILL_M
from rigcal.calibration import Calibration
from rigcal.exposures import name_in_result
from rigcal.frames import DetectedFrame, Look, Stream, look_at, streams_of
from rigcal.geometry.se3 import Array
from rigcal.observation import Candidate, Observation
from rigcal.plugin.registry import Registry
from rigcal.progress import Progress
from rigcal.rig import Rig
from rigcal.visibility import spots_in_view

_STAGE = "second look"
_log = logging.getLogger(__name__)


def look_again(
    rig: Rig,
    registry: Registry,
    recording: Path | str,
    observations: Sequence[Observation],
    calibration: Calibration,
    progress: Progress | None = None,
    jobs: int | None = None,
) -> tuple[Observation, ...]:
    """The observations, with what a second look found; the calibration is a first one of them.

    Where a sensor should have the target in view by the calibration, and none of its candidates is
    among the inliers, its frames are searched again near that place, by sensor types that offer
    `near`. What is found is one more candidate: whether it fits decides the next estimate.
    """
    streams = streams_of(rig, registry, Path(recording))
    wanted = _wanted(rig, streams, observations, calibration)
    looks: dict[str, list[Look]] = {name: [] for name in streams}
    for number, T_s_t in wanted.items():
        o = observations[number]
        looks[o.sensor] += [Look(i, T_s_t) for i in o.frames]
    if not wanted:
        return tuple(observations)
    frames = look_at(streams, looks, _STAGE, progress, jobs)
    by_frame = {(f.stamp.sensor, f.stamp.index): f for f in frames}
    result = list(observations)
    for number in wanted:
        o = observations[number]
        own = [by_frame[o.sensor, i] for i in o.frames]
        if (found := _found(streams[o.sensor], o, own)) is not None:
            result[number] = replace(o, candidates=(*o.candidates, found), reason="")
    return tuple(result)


def found_again(before: Sequence[Observation], after: Sequence[Observation]) -> dict[str, int]:
    """How many observations of each sensor a second look added a candidate to."""
    counts: dict[str, int] = {}
    for first, second in zip(before, after, strict=True):
        if len(second.candidates) > len(first.candidates):
            counts[first.sensor] = counts.get(first.sensor, 0) + 1
    return counts


def _wanted(
    rig: Rig,
    streams: Mapping[str, Stream],
    observations: Sequence[Observation],
    calibration: Calibration,
) -> dict[int, Array]:
    """`T_s_t` by the number of each observation that is worth a second look."""
    rejected = {(r.sensor, r.exposure) for r in calibration.rejected}
    wanted = {}
    for number, o in enumerate(observations):
        stream = streams[o.sensor]
        exposure = name_in_result(rig, o)
        if stream.kind.near is None or exposure not in calibration.target_poses or not o.frames:
            continue
        if o.candidates and (o.sensor, exposure) not in rejected:
            continue
        T_root_t = calibration.target_poses[exposure]
        T_s_t = calibration.T(o.sensor, calibration.root) @ T_root_t
        if len(spots_in_view(T_s_t, stream.kind, stream.config, stream.target)):
            wanted[number] = T_s_t
    return wanted


def _found(stream: Stream, o: Observation, frames: Sequence[DetectedFrame]) -> Candidate | None:
    """The candidate that most frames agree on, unless the observation has it."""
    candidates = [f.detection.candidates[0] for f in frames if f.detection.candidates]
    if not candidates:
        return None
    geometries = [c.geometry for c in (*candidates, *o.candidates)]
    places = places_of(geometries, stream.target)
    own, known = np.arange(len(candidates)), np.arange(len(candidates), len(geometries))
    same = places.same(own, own, STILL_M)
    agreed = same[np.argmax(same.sum(axis=1))]
    if 2 * agreed.sum() < len(frames):
        return None
    if places.same(own[agreed], known, STILL_M).any():
        return None
    try:
        return combine(stream, [c for c, agrees in zip(candidates, agreed, strict=True) if agrees])
    except (Exception, SystemExit):
        # As at the first look: a plugin that fails loses its frames, not the run.
        _log.debug("frames of %s could not be combined", stream.sensor, exc_info=True)
        return None
