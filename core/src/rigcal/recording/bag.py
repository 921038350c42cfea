"""ROS 1 and ROS 2 bags as recordings, without ROS: streamed through the rosbags library."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any, Self

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2
from rosbags.rosbag2.reader import DirectoryReader
from rosbags.rosbag2.storage_mcap import McapReader

from rigcal.errors import RecordingError
from rigcal.recording import damage
from rigcal.recording.message import STANDARD, Definitions, Message, Source
from rigcal.recording.stamps import log_times
from rigcal.recording.types import Deserialize, deserializer


class BagRecording:
    """A .bag, .mcap or .db3 file, or a ROS 2 bag folder.

    Messages are numbered per topic by log time. `stamp_ns` is the header's stamp; the log time for
    types without a header and for headers whose stamp was never set (0).
    """

    def __init__(self, path: Path, definitions: Definitions = STANDARD) -> None:
        self._path, self._definitions = path, definitions
        self._deserializers: dict[str, Deserialize] = {}
        self._times: dict[str, list[list[int]]] = {}
        self._reader: Reader1 | Reader2
        with self._no_library_errors("cannot be opened"):
            self._reader = Reader1(path) if path.suffix == ".bag" else Reader2(path)
            self._reader.open()

    def count(self, source: Source) -> int:
        """See `Recording`."""
        return sum(len(times) for times in self._log_times(source))

    def times_ns(self, source: Source) -> list[int]:
        """See `TimedRecording`."""
        return [time for times in self._log_times(source) for time in times]

    def read(self, source: Source, first: int = 0, stop: int | None = None) -> Iterator[Message]:
        """See `Recording`; of the messages outside the slice only the index is read."""
        topic = self._topic(source)
        skipped = 0
        for part, times in zip(self._parts, self._log_times(source), strict=True):
            begin = max(first - skipped, 0)
            end = len(times) if stop is None else min(stop - skipped, len(times))
            if begin < end:
                yield from self._read_part(part, topic, times, begin, end, skipped)
            skipped += len(times)

    def contents(self) -> Mapping[str, tuple[str, int]]:
        """Topic -> (message type, count)."""
        counts: dict[str, tuple[str, int]] = {}
        for c in sorted(self._connections, key=lambda c: c.topic):
            counts[c.topic] = (c.msgtype, counts.get(c.topic, ("", 0))[1] + c.msgcount)
        return counts

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self._reader.close()

    @cached_property
    def _parts(self) -> list[Any]:
        """The storage readers, one per file of the bag."""
        if isinstance(self._reader, Reader1):
            return [self._reader]
        storage = self._reader.storage
        return list(storage.storages) if isinstance(storage, DirectoryReader) else [storage]

    @property
    def _connections(self) -> list[Connection]:
        return [c for part in self._parts for c in part.connections]

    def _topic(self, source: Source) -> str:
        if source.topic is None:
            raise RecordingError(
                f"{self._path}: a bag has topics, and the sensor has only `files`; add "
                f"`topic: NAME` to it{self._listing()}"
            )
        types = {c.msgtype for c in self._connections if c.topic == source.topic}
        if not types:
            raise RecordingError(
                f"{self._path}: topic '{source.topic}' is not in the recording"
                f"{_guess(source.topic, self.contents())}{self._listing()}"
            )
        if len(types) > 1:
            raise RecordingError(
                f"{self._path}: topic '{source.topic}' carries several message types "
                f"({', '.join(sorted(types))}); expected one"
            )
        return source.topic

    def _log_times(self, source: Source) -> list[list[int]]:
        """Sorted log times (ns) of the topic's messages in each part; RecordingError if none."""
        topic = self._topic(source)
        if topic not in self._times:
            with self._no_library_errors("its index cannot be read"):
                parts = [log_times(part, _of(part, topic)) for part in self._parts]
            if not any(parts):
                raise RecordingError(
                    f"{self._path}: topic '{topic}' has no messages{self._listing()}"
                )
            self._times[topic] = parts
        return self._times[topic]

    def _read_part(
        self, part: Any, topic: str, times: list[int], begin: int, end: int, skipped: int
    ) -> Iterator[Message]:
        # Readers filter by time only: of several messages at the first stamp, some may be early.
        early = begin - bisect_left(times, times[begin])
        number = skipped + begin
        with self._no_library_errors(f"topic '{topic}' cannot be read"), _undisturbed(part) as own:
            connections = _of(own, topic)
            message_type = connections[0].msgtype
            deserialize = self._deserializer(topic, connections[0])
            raw = own.messages(connections, times[begin], times[end - 1] + 1)
            for _, log_time, data in islice(raw, early, early + end - begin):
                value = deserialize(data)
                origin = f"{self._path.name} {topic} #{number}"
                yield Message(message_type, value, _stamp(value) or log_time, None, origin)
                number += 1
        if number != skipped + end:
            raise RecordingError(
                f"{self._path}: topic '{topic}' ends at message {number} of {skipped + end} in the "
                f"index{damage.advice(self._path)}"
            )

    def _deserializer(self, topic: str, connection: Connection) -> Deserialize:
        if topic not in self._deserializers:
            compressed = (
                isinstance(self._reader, Reader2) and self._reader.compression_mode == "message"
            )
            ros_version = 1 if isinstance(self._reader, Reader1) else 2
            # A bag folder of several files may hold the definition in the first one only.
            same = [c for c in self._connections if c.msgtype == connection.msgtype]
            self._deserializers[topic] = deserializer(
                same, ros_version, self._definitions, compressed=compressed
            )
        return self._deserializers[topic]

    def _listing(self) -> str:
        lines = [f"\n  {t}  {kind}  {count}" for t, (kind, count) in self.contents().items()]
        return "; it holds:" + "".join(lines) if lines else "; it holds no topics"

    @contextmanager
    def _no_library_errors(self, what: str) -> Iterator[None]:
        """Damaged files make the library raise all sorts of errors: RecordingError for them."""
        try:
            yield
        except RecordingError:
            raise
        except Exception as error:
            reason = str(error).rstrip(".") or type(error).__name__
            if isinstance(error, OSError) and error.strerror:
                reason = error.strerror
            if isinstance(error, MemoryError):
                reason = "it asks for more memory than there is, as damaged lengths do"
            raise RecordingError(
                f"{self._path}: {what}: {reason}{damage.advice(self._path)}"
            ) from error


@contextmanager
def _undisturbed(part: Any) -> Iterator[Any]:
    """The reader, or one of its own where two reads at a time would move one file position."""
    if not isinstance(part, McapReader) or part.chunks:
        yield part
        return
    own = McapReader(part.path)
    own.open()
    try:
        yield own
    finally:
        own.close()


def _of(part: Any, topic: str) -> list[Connection]:
    return [c for c in part.connections if c.topic == topic]


def _stamp(value: Any) -> int:
    """`header.stamp` in ns; 0 if there is none."""
    stamp = getattr(getattr(value, "header", None), "stamp", None)
    return 0 if stamp is None else int(stamp.sec) * 10**9 + int(stamp.nanosec)


def _guess(topic: str, known: Mapping[str, object]) -> str:
    import difflib

    near = difflib.get_close_matches(topic, list(known), 1)
    return f", did you mean '{near[0]}'?" if near else ""
