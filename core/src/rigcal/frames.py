"""Frames of a recording through their sensors' detectors, in parallel processes."""

from __future__ import annotations

import logging
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigcal.errors import RecordingError
from rigcal.exposures import FrameStamp
from rigcal.geometry.se3 import Array
from rigcal.observation import Detection
from rigcal.observer import check_type, decoder_failure, detect_in_frame
from rigcal.plugin.contract import SensorConfig, SensorType
from rigcal.plugin.registry import Registry
from rigcal.progress import Progress
from rigcal.recording import (
    Message,
    Recording,
    RecordingFormat,
    Source,
    TimedRecording,
    open_recording,
)
from rigcal.rig import Rig, build_targets
from rigcal.targets.target import Target
from rigcal.workers import in_order

_FRAMES_PER_TASK = 8
_log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Stream:
    """The data of one sensor in a recording.

    `times_ns` (F,): about when its frames were recorded; 0 where the recording does not say.
    """

    recording: Path
    formats: tuple[RecordingFormat, ...]
    sensor: str
    config: SensorConfig
    kind: SensorType
    target: Target
    times_ns: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Look:
    """A frame to look at, by its place in the stream; near `T_s_t` (4, 4), or anywhere."""

    index: int
    T_s_t: Array | None = None


@dataclass(frozen=True, eq=False)
class DetectedFrame:
    """A frame and what its detector made of it."""

    stamp: FrameStamp
    origin: str
    detection: Detection
    unreadable: bool = False


@dataclass(frozen=True, eq=False)
class _Task:
    sensor: str
    looks: tuple[Look, ...]


def streams_of(rig: Rig, registry: Registry, recording: Path) -> dict[str, Stream]:
    """The stream of every sensor of a rig; RecordingError if one is missing."""
    targets = build_targets(rig, registry)
    formats, streams = tuple(registry.recording_formats.values()), {}
    with open_recording(recording, formats=formats) as opened:
        for name, config in rig.sensors.items():
            kind, target = registry.sensor_type(config.type), targets[rig.target_of(name)]
            try:
                times_ns = _times_ns(opened, config.source)
            except RecordingError as error:
                raise RecordingError(f"sensor '{name}': {error}") from error
            streams[name] = Stream(recording, formats, name, config, kind, target, times_ns)
    return streams


def _times_ns(opened: Recording, source: Source) -> NDArray[np.int64]:
    if isinstance(opened, TimedRecording):
        return np.array(opened.times_ns(source), dtype=np.int64)
    return np.zeros(opened.count(source), dtype=np.int64)


def look_at(
    streams: Mapping[str, Stream],
    looks: Mapping[str, Sequence[Look]],
    stage: str,
    progress: Progress | None = None,
    jobs: int | None = None,
) -> list[DetectedFrame]:
    """What the detectors make of some frames, by sensor and in the order of the stream.

    `jobs` processes share the frames (default: one per core; 1 stays in this process). The result
    does not depend on it.
    """
    tasks = [
        _Task(sensor, tuple(own[first : first + _FRAMES_PER_TASK]))
        for sensor, own in looks.items()
        for first in range(0, len(own), _FRAMES_PER_TASK)
    ]
    total = sum(len(t.looks) for t in tasks)
    tell = progress or (lambda *_: None)
    tell(stage, 0, total)
    frames: list[DetectedFrame] = []
    jobs = min(jobs or os.cpu_count() or 1, len(tasks))
    for part in in_order(_look, streams, tasks, jobs):
        frames.extend(part)
        tell(stage, len(frames), total)
    order = {s: i for i, s in enumerate(streams)}
    return sorted(frames, key=lambda f: (order[f.stamp.sensor], f.stamp.index))


def check_readable(frames: Sequence[DetectedFrame]) -> None:
    """RecordingError when no frame of a sensor could be read."""
    by_sensor: dict[str, list[DetectedFrame]] = {}
    for frame in frames:
        by_sensor.setdefault(frame.stamp.sensor, []).append(frame)
    for sensor, own in by_sensor.items():
        if all(f.unreadable for f in own):
            reason = own[0].detection.reason.removeprefix("unreadable: ")
            raise RecordingError(
                f"sensor '{sensor}': none of {len(own)} frames is usable: {reason}"
            )


def _look(streams: Mapping[str, Stream], task: _Task) -> list[DetectedFrame]:
    """A few frames of one stream (runs in a worker process)."""
    stream = streams[task.sensor]
    kind = stream.kind
    frames = []
    with open_recording(stream.recording, kind.message_definitions, stream.formats) as recording:
        for run in _runs(task.looks):
            messages = recording.read(stream.config.source, run[0].index, run[-1].index + 1)
            frames += [_looked_at(stream, *each) for each in zip(messages, run, strict=True)]
    return frames


def _runs(looks: Sequence[Look]) -> list[list[Look]]:
    """Looks at frames one after the other: what lies between two runs is not read."""
    runs: list[list[Look]] = []
    for look in sorted(looks, key=lambda look: look.index):
        if runs and look.index == runs[-1][-1].index + 1:
            runs[-1].append(look)
        else:
            runs.append([look])
    return runs


def _looked_at(stream: Stream, message: Message, look: Look) -> DetectedFrame:
    kind = stream.kind
    stamp = FrameStamp(stream.sensor, message.stamp_ns, message.exposure, look.index)
    check_type(stream.sensor, kind, message)
    try:
        frame = kind.decode(message, stream.config)
    except (Exception, SystemExit) as error:
        lost = Detection((), f"unreadable: {_decoder_error(stream, message, error)}")
        return DetectedFrame(stamp, message.origin, lost, unreadable=True)
    found = detect_in_frame(kind, stream.config, stream.target, frame, look.T_s_t)
    return DetectedFrame(stamp, message.origin, found)


def _decoder_error(stream: Stream, message: Message, error: BaseException) -> str:
    """Why a frame is lost: what the plugin says of the data, or that the plugin is at fault."""
    if isinstance(error, RecordingError):
        return str(error)
    _log.debug("decoder of %s raised", stream.sensor, exc_info=error)
    return decoder_failure(stream.kind, message, error)
