"""Recording -> observations: every frame through its sensor's detector, in parallel processes."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rigcal.errors import RecordingError
from rigcal.exposures import FrameStamp, exposure_names
from rigcal.observation import Detection, Observation
from rigcal.observer import check_type, decoder_failure, detect_in_frame
from rigcal.plugin.contract import SensorConfig, SensorType
from rigcal.plugin.registry import Registry
from rigcal.progress import Progress
from rigcal.recording import Message, RecordingFormat, open_recording
from rigcal.rig import Rig, build_targets
from rigcal.targets.target import Target

_FRAMES_PER_TASK = 8
_log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class _Task:
    recording: Path
    formats: tuple[RecordingFormat, ...]
    sensor: str
    config: SensorConfig
    kind: SensorType
    target: Target
    first: int
    stop: int


@dataclass(frozen=True, eq=False)
class _DetectedFrame:
    stamp: FrameStamp
    origin: str
    detection: Detection
    unreadable: bool = False


def detect(
    rig: Rig,
    registry: Registry,
    recording: Path | str,
    progress: Progress | None = None,
    jobs: int | None = None,
) -> tuple[Observation, ...]:
    """Observations of all sensors in a recording, by exposure and sensor; also those of frames in
    which the target was not found, which say why.

    `jobs` processes share the frames (default: one per core; 1 stays in this process). The result
    does not depend on it. RecordingError when a source is missing, or when no frame of a sensor
    can be read.
    """
    recording = Path(recording)
    tasks = _tasks(rig, registry, recording)
    total = sum(t.stop - t.first for t in tasks)
    tell = progress or (lambda *_: None)
    tell("detecting the target", 0, total)
    frames: list[_DetectedFrame] = []
    for part in _run(tasks, jobs or os.cpu_count() or 1):
        frames.extend(part)
        tell("detecting the target", len(frames), total)
    _check_readable(frames)
    order = {s: i for i, s in enumerate(rig.sensors)}
    frames.sort(key=lambda f: (order[f.stamp.sensor], f.stamp.index))
    return _observations(rig, frames)


def _tasks(rig: Rig, registry: Registry, recording: Path) -> list[_Task]:
    targets = build_targets(rig, registry)
    formats, tasks = tuple(registry.recording_formats.values()), []
    with open_recording(recording, formats=formats) as opened:
        for name, config in rig.sensors.items():
            kind, target = registry.sensor_type(config.type), targets[rig.target_of(name)]
            try:
                count = opened.count(config.source)
            except RecordingError as error:
                raise RecordingError(f"sensor '{name}': {error}") from error
            for first in range(0, count, _FRAMES_PER_TASK):
                stop = min(first + _FRAMES_PER_TASK, count)
                tasks.append(_Task(recording, formats, name, config, kind, target, first, stop))
    return tasks


def _run(tasks: Sequence[_Task], jobs: int) -> Iterable[list[_DetectedFrame]]:
    """Results of the tasks, in any order."""
    if jobs == 1 or len(tasks) < 2:
        return map(_detect_frames, tasks)
    from joblib import Parallel, delayed

    parallel = Parallel(n_jobs=min(jobs, len(tasks)), return_as="generator_unordered")
    results: Iterable[list[_DetectedFrame]] = parallel(delayed(_detect_frames)(t) for t in tasks)
    return results


def _detect_frames(task: _Task) -> list[_DetectedFrame]:
    """One slice of one sensor's stream (runs in a worker process)."""
    frames = []
    definitions = task.kind.message_definitions
    with open_recording(task.recording, definitions, task.formats) as recording:
        messages = recording.read(task.config.source, task.first, task.stop)
        for index, message in enumerate(messages, start=task.first):
            stamp = FrameStamp(task.sensor, message.stamp_ns, message.exposure, index)
            check_type(task.sensor, task.kind, message)
            try:
                frame = task.kind.decode(message, task.config)
            except Exception as error:
                lost = Detection((), f"unreadable: {_decoder_error(task, message, error)}")
                frames.append(_DetectedFrame(stamp, message.origin, lost, unreadable=True))
                continue
            detection = detect_in_frame(task.kind, task.config, task.target, frame)
            frames.append(_DetectedFrame(stamp, message.origin, detection))
    return frames


def _decoder_error(task: _Task, message: Message, error: Exception) -> str:
    """Why a frame is lost: what the plugin says of the data, or that the plugin is at fault."""
    if isinstance(error, RecordingError):
        return str(error)
    _log.debug("decoder of %s raised", task.sensor, exc_info=error)
    return decoder_failure(task.kind, message, error)


def _check_readable(frames: Sequence[_DetectedFrame]) -> None:
    by_sensor: dict[str, list[_DetectedFrame]] = {}
    for frame in frames:
        by_sensor.setdefault(frame.stamp.sensor, []).append(frame)
    for sensor, own in by_sensor.items():
        if all(f.unreadable for f in own):
            reason = own[0].detection.reason.removeprefix("unreadable: ")
            raise RecordingError(
                f"sensor '{sensor}': none of {len(own)} frames is usable: {reason}"
            )


def _observations(rig: Rig, frames: Sequence[_DetectedFrame]) -> tuple[Observation, ...]:
    names = exposure_names([f.stamp for f in frames], rig.association, rig.tolerance_s)
    result = []
    for frame, name in zip(frames, names, strict=True):
        candidates, reason = frame.detection.candidates, frame.detection.reason
        if name is None:
            candidates = ()
            reason = "another frame of this sensor is nearer to the middle of the exposure"
        exposure = name if name is not None else f"stamp {frame.stamp.stamp_ns}"
        s = frame.stamp
        result.append(Observation(s.sensor, exposure, s.stamp_ns, frame.origin, candidates, reason))
    return tuple(result)
