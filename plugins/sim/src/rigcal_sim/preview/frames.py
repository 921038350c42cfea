"""The frame that each sensor took of an exposure, found in the recording by its stamp."""

from __future__ import annotations

from rigcal.errors import RecordingError
from rigcal.plugin import FrameView, Registry
from rigcal.recording import Recording, nearest_message
from rigcal.rig import Rig


def views(
    rig: Rig, registry: Registry, recording: Recording, hold_ns: tuple[int, int]
) -> dict[str, FrameView | str]:
    """What each sensor saw while the board was held still, or why that cannot be shown."""
    start, end = hold_ns
    result: dict[str, FrameView | str] = {}
    for name, config in rig.sensors.items():
        view = registry.sensor_type(config.type).view
        message = nearest_message(recording, config.source, (start + end) // 2)
        if view is None:
            result[name] = f"sensor type '{config.type}' offers no view"
        elif message is None or not start <= message.stamp_ns <= end:
            result[name] = "no frame while the board was held still"
        else:
            try:
                result[name] = view(message, config)
            except RecordingError as error:
                result[name] = str(error)
    return result
