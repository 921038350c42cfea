"""A continuous recording: its exposures, and which frames to look at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcal.association.rest import Sightings, sightings_of
from rigcal.association.still import Interval, is_held, still_intervals
from rigcal.errors import RecordingError
from rigcal.frames import DetectedFrame, Stream
from rigcal.rig import Rig

FIRST_LOOK_S = 1 / 3
"""Between two frames of the first look: a hold of a second shows three."""
MOST_FRAMES = 10
"""Frames of a sensor that are combined: more of them lower little else than the last noise."""


@dataclass(frozen=True, eq=False)
class Exposure:
    """Where the board stands still: its name, stamps (ns) of start and end, and who looks at it."""

    name: str
    start_ns: int
    end_ns: int
    sensors: frozenset[str]


def first_look(times_ns: NDArray[np.int64]) -> NDArray[np.intp]:
    """Frames (among F) that show when the board is held still: three a second, if there are."""
    part = (times_ns - times_ns[:1]) // round(FIRST_LOOK_S * 1e9)
    return np.sort(np.unique(part, return_index=True)[1])


def still_exposures(
    rig: Rig, streams: Mapping[str, Stream], frames: Sequence[DetectedFrame]
) -> list[Exposure] | None:
    """The exposures that the frames of the first look show; None if the board is not held still.

    RecordingError if the rig says that it is.
    """
    origin_ns = min(f.stamp.stamp_ns for f in frames)
    sightings = sightings_by_sensor(streams, frames)
    found: list[tuple[Interval, frozenset[str]]] = []
    held = False
    for target in rig.targets:
        own = [sightings[name] for name in streams if rig.target_of(name) == target]
        intervals = still_intervals(own, rig.hold_s)
        held |= is_held(intervals, own)
        found += [(interval, frozenset(s.sensor for s in own)) for interval in intervals]
    if rig.association != "still" and not held:
        return None
    if not found:
        raise RecordingError(
            f"the board is nowhere held still for {rig.hold_s:g} s, as `association: still` says; "
            "hold it longer, lower `hold_s`, or leave `association` out"
        )
    found.sort(key=lambda item: item[0])
    return [
        Exposure(
            f"{number:04d}", origin_ns + round(start * 1e9), origin_ns + round(end * 1e9), sensors
        )
        for number, ((start, end), sensors) in enumerate(found)
    ]


def more_frames(
    exposures: Sequence[Exposure], frames: Sequence[DetectedFrame]
) -> dict[str, NDArray[np.intp]]:
    """Frames by sensor to look at beside those of the first look, evenly within exposures.

    Only of sensors that found a candidate there.
    """
    chosen: dict[str, NDArray[np.intp]] = {}
    for exposure in exposures:
        for sensor, own in _within(exposure, frames).items():
            seen = [f.stamp.index for f in own]
            wanted = MOST_FRAMES - len(seen)
            if wanted <= 0 or not any(f.detection.candidates for f in own):
                continue
            between = np.setdiff1d(np.arange(seen[0], seen[-1] + 1), seen)
            steps = np.linspace(0, len(between) - 1, min(wanted, len(between)))
            new = between[np.unique(np.round(steps).astype(np.intp))]
            chosen[sensor] = np.union1d(chosen.get(sensor, new), new).astype(np.intp)
    return chosen


def by_sensor(
    streams: Mapping[str, Stream], frames: Sequence[DetectedFrame]
) -> dict[str, list[DetectedFrame]]:
    """Frames by sensor, in their order."""
    result: dict[str, list[DetectedFrame]] = {name: [] for name in streams}
    for frame in frames:
        result[frame.stamp.sensor].append(frame)
    return result


def sightings_by_sensor(
    streams: Mapping[str, Stream], frames: Sequence[DetectedFrame]
) -> dict[str, Sightings]:
    """Where each sensor sees what, at times (s) since the first of the frames."""
    origin_ns = min(f.stamp.stamp_ns for f in frames)
    return {
        name: sightings_of(
            name,
            np.array([(f.stamp.stamp_ns - origin_ns) * 1e-9 for f in own]),
            [f.detection for f in own],
            streams[name].target,
        )
        for name, own in by_sensor(streams, frames).items()
    }


def _within(exposure: Exposure, frames: Sequence[DetectedFrame]) -> dict[str, list[DetectedFrame]]:
    inside: dict[str, list[DetectedFrame]] = {}
    for frame in frames:
        s = frame.stamp
        if s.sensor in exposure.sensors and exposure.start_ns <= s.stamp_ns <= exposure.end_ns:
            inside.setdefault(s.sensor, []).append(frame)
    return inside
