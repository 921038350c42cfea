"""Writes recordings: MCAP (ROS 2) and .bag (ROS 1), without ROS."""

from __future__ import annotations

import tempfile
from collections import Counter
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Protocol, Self

from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

from rigcal.errors import RecordingError
from rigcal.recording import ros
from rigcal.recording.message import Definitions
from rigcal.recording.ros1 import to_ros1

_LATCHED_TOPICS = ("/tf_static",)
_QOS_LATCHED = Qos(
    QosHistory.KEEP_LAST,
    1,
    QosReliability.RELIABLE,
    QosDurability.TRANSIENT_LOCAL,
    QosTime(0, 0),
    QosTime(0, 0),
    QosLiveliness.SYSTEM_DEFAULT,
    QosTime(0, 0),
    avoid_ros_namespace_conventions=False,
)


class _Format(Protocol):
    """One file format."""

    def connect(self, topic: str, type_name: str, definitions: Definitions) -> Connection: ...

    def write(self, connection: Connection, message: Any, stamp_ns: int, number: int) -> None: ...

    def close(self) -> Path: ...

    def abort(self) -> None: ...


class RecordingWriter:
    """One recording file: `with RecordingWriter(path) as writer: writer.write(...)`.

    The suffix chooses the format: .mcap (ROS 2, CDR, definitions embedded, zstd chunks) or .bag
    (ROS 1). The file appears at `path`, replacing what was there, when the block ends without an
    exception; before that, and after an exception, there is none. The same messages give the same
    bytes. Messages are those of `rigcal.recording.ros.make` for both formats.
    """

    def __init__(self, path: Path | str) -> None:
        self._path = Path(path)
        if self._path.suffix not in _FORMATS:
            raise RecordingError(
                f"{path}: a recording is written as {' or '.join(_FORMATS)}, "
                f"not as '{self._path.suffix}'"
            )
        self._connections: dict[str, Connection] = {}
        self._counts: Counter[str] = Counter()
        self._stack = ExitStack()
        self._format: _Format | None = None

    def __enter__(self) -> Self:
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            folder = self._stack.enter_context(
                tempfile.TemporaryDirectory(prefix=f".{self._path.name}.", dir=self._path.parent)
            )
            self._format = _FORMATS[self._path.suffix](Path(folder) / self._path.stem)
        except OSError as error:
            self._stack.close()
            raise self._not_written(error) from error
        return self

    def __exit__(self, kind: type[BaseException] | None, *exc: object) -> None:
        assert self._format is not None
        file, self._format = self._format, None
        with self._stack:
            if kind is not None:
                file.abort()
                return
            try:
                file.close().replace(self._path)
            except OSError as error:
                file.abort()
                raise self._not_written(error) from error

    def write(self, topic: str, type_name: str, message: Any, stamp_ns: int) -> None:
        """Append a message; `stamp_ns` is its log time.

        RecordingError if the topic had another type before, if the type is unknown, if the message
        does not fit its type, or if the disk is full.
        """
        if self._format is None:
            raise RecordingError(f"{self._path}: the recording is not open for writing")
        if stamp_ns < 0:
            raise RecordingError(f"{self._path}: {topic}: stamp {stamp_ns} ns is negative")
        if topic not in self._connections:
            definitions = ros.definitions_of(message)
            if type_name not in ros.typestore(definitions).fielddefs:
                raise RecordingError(f"'{type_name}' is not a message type of ROS 2 Humble")
            self._connections[topic] = self._format.connect(topic, type_name, definitions)
        connection = self._connections[topic]
        if connection.msgtype != type_name:
            raise RecordingError(
                f"{self._path}: topic '{topic}' carries {connection.msgtype}, not {type_name}"
            )
        try:
            self._format.write(connection, message, stamp_ns, self._counts[topic])
        except OSError as error:
            raise self._not_written(error) from error
        except RecordingError as error:
            raise RecordingError(f"{self._path}: {topic}: {error}") from error
        except Exception as error:
            raise RecordingError(
                f"{self._path}: {topic}: the message does not fit {type_name}: {error}"
            ) from error
        self._counts[topic] += 1

    def _not_written(self, error: OSError) -> RecordingError:
        return RecordingError(f"{self._path}: cannot be written: {error.strerror or error}")


class _Mcap:
    def __init__(self, stem: Path) -> None:
        # rosbags writes a folder <name>/ with <name>.mcap in it; we want the file alone.
        self._file = stem / f"{stem.name}.mcap"
        self._writer = Writer2(stem, version=8, storage_plugin=StoragePlugin.MCAP)
        self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        self._writer.open()

    def connect(self, topic: str, type_name: str, definitions: Definitions) -> Connection:
        store = ros.typestore(definitions)
        latched = [_QOS_LATCHED] if topic in _LATCHED_TOPICS else []
        return self._writer.add_connection(
            topic, type_name, typestore=store, offered_qos_profiles=latched
        )

    def write(self, connection: Connection, message: Any, stamp_ns: int, number: int) -> None:
        store = ros.typestore(ros.definitions_of(message))
        data = store.serialize_cdr(message, connection.msgtype, little_endian=True)
        self._writer.write(connection, stamp_ns, data)

    def close(self) -> Path:
        self._writer.close()
        return self._file

    def abort(self) -> None:
        self._writer.abort()


class _Bag:
    def __init__(self, stem: Path) -> None:
        self._file = stem.with_name(f"{stem.name}.bag")
        self._writer = Writer1(self._file)
        self._writer.open()

    def connect(self, topic: str, type_name: str, definitions: Definitions) -> Connection:
        store = ros.ros1_typestore(definitions)
        if type_name not in store.fielddefs:
            raise RecordingError(
                f"'{type_name}' is not a message type of ROS 1: write an MCAP instead"
            )
        latched = 1 if topic in _LATCHED_TOPICS else None
        return self._writer.add_connection(
            topic, type_name, typestore=store, callerid="/rigcal", latching=latched
        )

    def write(self, connection: Connection, message: Any, stamp_ns: int, number: int) -> None:
        definitions = ros.definitions_of(message)
        old = to_ros1(message, connection.msgtype, number, definitions)
        data = ros.ros1_typestore(definitions).serialize_ros1(old, connection.msgtype)
        self._writer.write(connection, stamp_ns, data)

    def close(self) -> Path:
        self._writer.close()
        return self._file

    def abort(self) -> None:
        self._writer.abort()


_FORMATS: dict[str, type[_Mcap] | type[_Bag]] = {".mcap": _Mcap, ".bag": _Bag}
