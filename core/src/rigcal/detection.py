"""Recording -> observations: which frames are looked at, and which of them are one exposure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigcal.association.continuous import (
    first_look,
    more_frames,
    still_exposures,
)
from rigcal.association.gathering import still_observations
from rigcal.association.single import single_observations
from rigcal.errors import RecordingError
from rigcal.frames import DetectedFrame, Look, Stream, check_readable, look_at, streams_of
from rigcal.observation import Observation
from rigcal.plugin.registry import Registry
from rigcal.progress import Progress
from rigcal.rig import Rig

_STAGE = "detecting the target"


def detect(
    rig: Rig,
    registry: Registry,
    recording: Path | str,
    progress: Progress | None = None,
    jobs: int | None = None,
) -> tuple[Observation, ...]:
    """Observations of all sensors in a recording, by exposure and sensor; also those of frames in
    which the target was not found, or that are left out, which say why.

    Exposures are found as `rig.association` says, and what a sensor finds in the same place
    throughout the recording is background and no candidate. Where the target is held still, a few
    frames a second tell when; then a few more of each exposure are looked at, and those of one
    sensor are combined. `jobs` processes share the frames (default: one per core; 1 stays in this
    process). The result does not depend on it. RecordingError when a source is missing, or when no
    frame of a sensor can be read.
    """
    streams = streams_of(rig, registry, Path(recording))
    every = {name: np.arange(len(s.times_ns)) for name, s in streams.items()}
    if not _may_be_still(rig, streams):
        frames = _look(streams, every, progress, jobs)
        check_readable(frames)
        return single_observations(rig, streams, frames)
    chosen = {name: first_look(s.times_ns) for name, s in streams.items()}
    frames = _look(streams, chosen, progress, jobs)
    check_readable(frames)
    exposures = still_exposures(rig, streams, frames)
    if exposures is not None:
        more = _look(streams, more_frames(exposures, frames), progress, jobs)
        return still_observations(exposures, streams, _in_order(streams, [*frames, *more]))
    rest = {name: np.setdiff1d(every[name], chosen[name]) for name in streams}
    more = _look(streams, rest, progress, jobs)
    return single_observations(rig, streams, _in_order(streams, [*frames, *more]))


def _may_be_still(rig: Rig, streams: Mapping[str, Stream]) -> bool:
    stamped = {name: bool((s.times_ns > 0).all()) for name, s in streams.items()}
    if rig.association == "still" and not all(stamped.values()):
        name = next(name for name, has_stamps in stamped.items() if not has_stamps)
        raise RecordingError(
            f"sensor '{name}': its files carry no stamps, and `association: still` rests on them; "
            "name the files by their stamps in ns, or leave `association` out"
        )
    return rig.association == "still" or (rig.association is None and all(stamped.values()))


def _look(
    streams: Mapping[str, Stream],
    chosen: Mapping[str, NDArray[np.intp]],
    progress: Progress | None,
    jobs: int | None,
) -> list[DetectedFrame]:
    looks = {name: [Look(int(i)) for i in own] for name, own in chosen.items()}
    if not any(looks.values()):
        return []
    return look_at(streams, looks, _STAGE, progress, jobs)


def _in_order(
    streams: Mapping[str, Stream], frames: Sequence[DetectedFrame]
) -> list[DetectedFrame]:
    order = {name: i for i, name in enumerate(streams)}
    return sorted(frames, key=lambda f: (order[f.stamp.sensor], f.stamp.index))
