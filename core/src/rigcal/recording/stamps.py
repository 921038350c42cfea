"""The log times of a topic's messages, from the index of a bag file."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from rigcal.errors import RecordingError

_INDEX_RECORD = struct.Struct("<BQHI")
_MESSAGE_INDEX = 0x07


def log_times(part: Any, connections: Sequence[Connection]) -> list[int]:
    """Sorted log times (ns) of the messages of `connections` in one storage reader.

    Message data are read only where the file has no index (an MCAP without chunks).
    """
    if not connections:
        return []
    if isinstance(part, Reader1):
        return sorted(entry.time for c in connections for entry in part.indexes[c.id])
    if isinstance(part, Sqlite3Reader):
        return _from_sqlite(part, connections)
    if isinstance(part, McapReader) and part.chunks:
        return _from_mcap(part, connections)
    return [time for _, time, _ in part.messages(connections)]


def _from_sqlite(part: Sqlite3Reader, connections: Sequence[Connection]) -> list[int]:
    assert part.dbconn is not None
    places = ",".join("?" * len(connections))
    query = f"SELECT timestamp FROM messages WHERE topic_id IN ({places}) ORDER BY timestamp"
    return [int(row[0]) for row in part.dbconn.execute(query, [c.id for c in connections])]


def _from_mcap(part: McapReader, connections: Sequence[Connection]) -> list[int]:
    """From the Message Index records that follow each chunk (MCAP specification)."""
    assert part.bio is not None
    found = [np.empty(0, np.uint64)]
    for chunk in part.chunks:
        for c in connections:
            offset = chunk.message_index_offsets.get(c.id)
            if offset is None:
                continue
            part.bio.seek(offset)
            op, _, channel, size = _INDEX_RECORD.unpack(part.bio.read(_INDEX_RECORD.size))
            if op != _MESSAGE_INDEX or channel != c.id:
                raise RecordingError(
                    f"{part.path}: the index of topic '{c.topic}' at byte {offset} is damaged; "
                    f"rebuild it with `mcap recover {part.path} -o mended.mcap`"
                )
            entries = np.frombuffer(part.bio.read(size), "<u8").reshape(-1, 2)
            found.append(entries[:, 0].astype(np.uint64))
    times = np.sort(np.concatenate(found)).tolist()
    expected = sum(c.msgcount for c in connections)
    if len(times) < expected:
        # rosbags would pass over chunks without an index in silence.
        raise RecordingError(
            f"{part.path}: the index of topic '{connections[0].topic}' has {len(times)} of its "
            f"{expected} messages; rebuild it with `mcap recover {part.path} -o mended.mcap`"
        )
    return [int(t) for t in times]
