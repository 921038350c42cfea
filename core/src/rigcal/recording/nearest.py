"""The message of a source that is nearest in time."""

from __future__ import annotations

from bisect import bisect_left

from rigcal.recording.message import Message, Recording, Source, TimedRecording


def nearest_message(recording: Recording, source: Source, stamp_ns: int) -> Message | None:
    """The message of a source whose stamp is nearest to `stamp_ns`; few messages are read.

    None if the source has no message. Stamps are taken to rise along the source. RecordingError if
    the recording does not hold it.
    """
    count = recording.count(source)
    if not count:
        return None

    def at(index: int) -> Message:
        return next(iter(recording.read(source, index, index + 1)))

    def off(message: Message) -> int:
        return abs(message.stamp_ns - stamp_ns)

    if isinstance(recording, TimedRecording):
        index = bisect_left(recording.times_ns(source), stamp_ns)
    else:
        index = bisect_left(range(count), stamp_ns, key=lambda i: at(i).stamp_ns)
    index = min(index, count - 1)
    best = at(index)
    # Messages are recorded some time after their stamps, and the one before may be nearer.
    step = 1 if best.stamp_ns < stamp_ns else -1
    while 0 <= index + step < count:
        index += step
        other = at(index)
        if off(other) >= off(best):
            break
        best = other
    return best
