"""What a recording hands to a sensor plugin: one message or one file, with its stamp."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self, runtime_checkable

Definitions = Mapping[str, str]
"""Text of .msg files by ROS name ("radar_msgs/msg/RadarScan"), of types ROS does not bring."""
STANDARD: Definitions = {}


@dataclass(frozen=True)
class Source:
    """Where a sensor's data are found: a topic of a bag, or a glob below a folder."""

    topic: str | None = None
    files: str | None = None


@dataclass(frozen=True)
class Message:
    """One message of one sensor.

    `type` is a ROS name ("sensor_msgs/msg/Image") or a file suffix (".png"). `value` is the
    deserialised ROS message (attribute access by field name, arrays as numpy) or the file's Path.
    `stamp_ns` is the header stamp; files without one have `exposure`, the key that their name
    carries, and stamp 0. `origin` says where it came from, for messages to people.
    """

    type: str
    value: Any
    stamp_ns: int
    exposure: str | None
    origin: str


class Recording(Protocol):
    """A recording opened for reading: `with open_recording(path) as recording: ...`."""

    def count(self, source: Source) -> int:
        """How many messages the source holds; RecordingError (what is there) if none."""

    def read(self, source: Source, first: int = 0, stop: int | None = None) -> Iterator[Message]:
        """Messages number `first` to `stop` (exclusive) of a source, in order, streamed."""

    def contents(self) -> Mapping[str, tuple[str, int]]:
        """Message type and count per topic (per suffix for a folder)."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *exc: object) -> None: ...


@runtime_checkable
class TimedRecording(Recording, Protocol):
    """A recording that knows when its messages were recorded: exposures can be found by stillness.

    One that does not is read as files without stamps are: by `nearest` or `same_index`.
    """

    def times_ns(self, source: Source) -> Sequence[int]:
        """When each message of a source was recorded, in order, without reading them.

        Near its header stamp; 0 for files whose names carry no stamp.
        """
