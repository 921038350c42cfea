"""Small recordings of every kind, each with the same messages."""

from __future__ import annotations

import shutil
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from rigcal.recording import ros
from rigcal.recording.writer import RecordingWriter

SCAN = "sensor_msgs/msg/LaserScan"
STAMPS = [10**18 + i * 10**8 for i in range(12)]


def scan(number: int) -> object:
    """Its header stamp is 5 ns before its log time."""
    return ros.make(
        SCAN,
        header=ros.header(STAMPS[number] - 5, "front"),
        angle_min=-1.0,
        ranges=np.arange(number + 3),
    )


def _by_recording_writer(path: Path) -> Path:
    with RecordingWriter(path) as writer:
        for i, stamp in enumerate(STAMPS):
            writer.write("/front/scan", SCAN, scan(i), stamp)
            if i % 3 == 0:
                clock = ros.make("std_msgs/msg/String", data=f"tick {i}")
                writer.write("/tick", "std_msgs/msg/String", clock, stamp)
    return path


def _bag_folder(
    path: Path,
    storage: StoragePlugin,
    compression: CompressionMode = CompressionMode.NONE,
    numbers: range = range(len(STAMPS)),
) -> Path:
    writer = Writer(path, version=8, storage_plugin=storage)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    store = ros.typestore()
    with writer:
        front = writer.add_connection("/front/scan", SCAN, typestore=store)
        tick = writer.add_connection("/tick", "std_msgs/msg/String", typestore=store)
        for i in numbers:
            writer.write(front, STAMPS[i], store.serialize_cdr(scan(i), SCAN))
            if i % 3 == 0:
                message = ros.make("std_msgs/msg/String", data=f"tick {i}")
                writer.write(tick, STAMPS[i], store.serialize_cdr(message, "std_msgs/msg/String"))
    return path


def _two_files(path: Path) -> Path:
    """A bag folder of two files, as a recorder that splits by size leaves it."""
    _bag_folder(path, StoragePlugin.MCAP)
    for number, numbers in enumerate((range(5), range(5, len(STAMPS)))):
        part = _bag_folder(path.with_name(f"part{number}"), StoragePlugin.MCAP, numbers=numbers)
        shutil.move(part / f"{part.name}.mcap", path / f"bag_{number}.mcap")
        shutil.rmtree(part)
    (path / f"{path.name}.mcap").unlink()
    metadata = path / "metadata.yaml"
    text = metadata.read_text()
    whole = f"  relative_file_paths:\n  - {path.name}.mcap\n"
    assert whole in text
    split = "  relative_file_paths:\n  - bag_0.mcap\n  - bag_1.mcap\n"
    metadata.write_text(text.replace(whole, split))
    return path


def _record(op: int, data: bytes) -> bytes:
    return struct.pack("<BQ", op, len(data)) + data


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode()


def unindexed_mcap(path: Path, profile: str = "ros2") -> Path:
    """An MCAP file without chunks, index and summary (written by hand, per the specification)."""
    store = ros.typestore()
    topics = [("/front/scan", SCAN), ("/tick", "std_msgs/msg/String")]
    records = [_record(0x01, _text(profile) + _text("by hand"))]
    for i, (topic, kind) in enumerate(topics, start=1):
        definition = _text(store.generate_msgdef(kind, ros_version=2)[0])
        records.append(
            _record(0x03, struct.pack("<H", i) + _text(kind) + _text("ros2msg") + definition)
        )
        channel = struct.pack("<HH", i, i) + _text(topic) + _text("cdr") + struct.pack("<I", 0)
        records.append(_record(0x04, channel))
    for i, stamp in enumerate(STAMPS):
        messages = [(1, SCAN, scan(i))]
        if i % 3 == 0:
            messages.append((2, topics[1][1], ros.make(topics[1][1], data=f"tick {i}")))
        for channel_id, kind, message in messages:
            data = bytes(store.serialize_cdr(message, kind))
            records.append(_record(0x05, struct.pack("<HIQQ", channel_id, 0, stamp, stamp) + data))
    records.append(_record(0x0F, bytes(4)))
    records.append(_record(0x02, bytes(20)))
    magic = b"\x89MCAP0\r\n"
    path.write_bytes(magic + b"".join(records) + magic)
    return path


def _compressed_bag(path: Path) -> Path:
    store = ros.ros1_typestore()
    from rigcal.recording.ros1 import to_ros1

    writer = Writer1(path)
    writer.set_compression(Writer1.CompressionFormat.BZ2)
    with writer:
        front = writer.add_connection("/front/scan", SCAN, typestore=store)
        tick = writer.add_connection("/tick", "std_msgs/msg/String", typestore=store)
        for i, stamp in enumerate(STAMPS):
            writer.write(front, stamp, store.serialize_ros1(to_ros1(scan(i), SCAN), SCAN))
            if i % 3 == 0:
                message = to_ros1(ros.make("std_msgs/msg/String", data=f"tick {i}"), tick.msgtype)
                writer.write(tick, stamp, store.serialize_ros1(message, tick.msgtype))
    return path


KINDS: dict[str, Callable[[Path], Path]] = {
    "mcap": lambda d: _by_recording_writer(d / "recording.mcap"),
    "ros1": lambda d: _by_recording_writer(d / "recording.bag"),
    "ros1 bz2": lambda d: _compressed_bag(d / "recording.bag"),
    "sqlite3 folder": lambda d: _bag_folder(d / "bag", StoragePlugin.SQLITE3),
    "sqlite3 folder, messages compressed": lambda d: _bag_folder(
        d / "bag", StoragePlugin.SQLITE3, CompressionMode.MESSAGE
    ),
    "sqlite3 folder, file compressed": lambda d: _bag_folder(
        d / "bag", StoragePlugin.SQLITE3, CompressionMode.FILE
    ),
    "mcap folder": lambda d: _bag_folder(d / "bag", StoragePlugin.MCAP),
    "mcap folder of two files": lambda d: _two_files(d / "bag"),
    "db3": lambda d: _bag_folder(d / "bag", StoragePlugin.SQLITE3) / "bag.db3",
    "mcap without index": lambda d: unindexed_mcap(d / "recording.mcap"),
}


@pytest.fixture(params=list(KINDS))
def bag(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """Scans 0 to 11 on /front/scan (scan i has i + 3 ranges), a string on /tick every third."""
    return KINDS[request.param](tmp_path)


@pytest.fixture
def make_bag(tmp_path: Path) -> Callable[[str], Path]:
    return lambda kind: KINDS[kind](tmp_path)


@pytest.fixture
def make_unindexed(tmp_path: Path) -> Callable[[str], Path]:
    return lambda profile: unindexed_mcap(tmp_path / "recording.mcap", profile)
