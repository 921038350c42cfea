"""The frames of a recording that are shown, found again."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from rigcal.calibration import Calibration
from rigcal.errors import RecordingError
from rigcal.observation import Observation
from rigcal.plugin.contract import FrameView, SensorConfig
from rigcal.plugin.registry import Registry
from rigcal.progress import Progress
from rigcal.recording import open_recording
from rigcal.report.sensor_errors import config_of
from rigcal.rig import Rig

Show = Callable[[Observation, FrameView], None]


def show_frames(
    recording: Path,
    calibration: Calibration,
    rig: Rig,
    registry: Registry,
    wanted: Iterable[Observation],
    show: Show,
    progress: Progress | None = None,
) -> None:
    """Call `show` for each wanted observation whose frame the recording holds.

    Views are those of the configs as the calibration refined them. Frames are read one after the
    other, and never kept. Sensor types without `view`, and frames that cannot be decoded, are
    passed over: their reasons stand in the result.
    """
    by_sensor: dict[str, list[Observation]] = {}
    for o in wanted:
        if registry.sensor_type(rig.sensors[o.sensor].type).view is not None:
            by_sensor.setdefault(o.sensor, []).append(o)
    tell, total = progress or (lambda *_: None), sum(map(len, by_sensor.values()))
    done = 0
    for sensor, own in by_sensor.items():
        tell("reading frames", done, total)
        config = config_of(calibration, rig, registry, sensor)
        _show_stream(recording, config, registry, own, show)
        done += len(own)
    tell("reading frames", total, total)


def _show_stream(
    recording: Path,
    config: SensorConfig,
    registry: Registry,
    own: list[Observation],
    show: Show,
) -> None:
    kind = registry.sensor_type(config.type)
    assert kind.view is not None
    formats = tuple(registry.recording_formats.values())
    open_ones = {o.origin: o for o in own}
    with open_recording(recording, kind.message_definitions, formats) as opened:
        for message in opened.read(config.source):
            o = open_ones.pop(message.origin, None)
            if o is not None:
                try:
                    show(o, kind.view(message, config))
                except RecordingError:
                    continue
            if not open_ones:
                return
