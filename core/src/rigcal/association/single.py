"""The observations of a recording with one frame of each sensor per exposure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from rigcal.association.continuous import by_sensor
from rigcal.association.rest import BACKGROUND, sightings_of
from rigcal.exposures import exposure_names
from rigcal.frames import DetectedFrame, Stream
from rigcal.observation import Candidate, Observation
from rigcal.rig import Rig

_NOT_THE_NEAREST = "another frame of this sensor is nearer to the middle of the exposure"


def single_observations(
    rig: Rig, streams: Mapping[str, Stream], frames: Sequence[DetectedFrame]
) -> tuple[Observation, ...]:
    """One frame of each sensor per exposure, and the others, which say so."""
    ordered = by_sensor(streams, frames)
    candidates = [c for sensor, own in ordered.items() for c in _foreground(streams[sensor], own)]
    in_order = [f for own in ordered.values() for f in own]
    stamps = [f.stamp for f in in_order]
    names = exposure_names(stamps, rig.association or "nearest", rig.tolerance_s)
    return tuple(map(_observation, in_order, candidates, names))


def _foreground(stream: Stream, own: Sequence[DetectedFrame]) -> Iterator[tuple[Candidate, ...]]:
    """Each frame's candidates without those of the background."""
    order = np.arange(len(own), dtype=np.float64)
    sightings = sightings_of(stream.sensor, order, [f.detection for f in own], stream.target)
    for i, frame in enumerate(own):
        kept = sightings.number[sightings.foreground(i)]
        yield tuple(frame.detection.candidates[int(k)] for k in kept)


def _observation(
    frame: DetectedFrame, candidates: tuple[Candidate, ...], exposure: str | None
) -> Observation:
    s, reason = frame.stamp, frame.detection.reason
    if frame.detection.candidates and not candidates:
        reason = BACKGROUND
    if exposure is None:
        candidates, reason, exposure = (), _NOT_THE_NEAREST, f"stamp {s.stamp_ns}"
    return Observation(s.sensor, exposure, s.stamp_ns, frame.origin, candidates, reason, (s.index,))
