"""The frame that each sensor took of an exposure, found in the recording by its stamp."""

from __future__ import annotations

from dataclasses import dataclass

from rigcal.errors import RecordingError
from rigcal.plugin import FrameView, Registry
from rigcal.recording.message import Message, Recording, Source
from rigcal.rig import Rig

_NEAR = 0.25


@dataclass(frozen=True)
class Stream:
    """The messages of one sensor: how many, the first one's stamp and the mean period (ns)."""

    recording: Recording
    source: Source
    count: int
    first_ns: int
    period_ns: float

    def nearest(self, stamp_ns: int) -> Message:
        """The message whose stamp is nearest: where it should be if they came evenly, and on."""
        index = round((stamp_ns - self.first_ns) / self.period_ns)
        index = min(max(index, 0), self.count - 1)
        best = self._at(index)
        step = 1 if best.stamp_ns < stamp_ns else -1
        while (
            abs(best.stamp_ns - stamp_ns) > _NEAR * self.period_ns
            and 0 <= index + step < self.count
        ):
            index += step
            other = self._at(index)
            if abs(other.stamp_ns - stamp_ns) >= abs(best.stamp_ns - stamp_ns):
                break
            best = other
        return best

    def _at(self, index: int) -> Message:
        return next(iter(self.recording.read(self.source, index, index + 1)))


def open_stream(recording: Recording, source: Source) -> Stream:
    """The stream of a sensor; RecordingError if the recording does not hold it."""
    count = recording.count(source)
    first, last = (
        next(iter(recording.read(source, index, index + 1))).stamp_ns for index in (0, count - 1)
    )
    return Stream(recording, source, count, first, max((last - first) / max(count - 1, 1), 1.0))


def views(
    rig: Rig, registry: Registry, streams: dict[str, Stream], hold_ns: tuple[int, int]
) -> dict[str, FrameView | str]:
    """What each sensor saw while the board was held still, or why that cannot be shown."""
    start, end = hold_ns
    result: dict[str, FrameView | str] = {}
    for name, stream in streams.items():
        view = registry.sensor_type(rig.sensors[name].type).view
        message = stream.nearest((start + end) // 2)
        if view is None:
            result[name] = f"sensor type '{rig.sensors[name].type}' offers no view"
        elif not start <= message.stamp_ns <= end:
            result[name] = "no frame while the board was held still"
        else:
            try:
                result[name] = view(message, rig.sensors[name])
            except RecordingError as error:
                result[name] = str(error)
    return result
