"""The same messages come out of every kind of bag."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from rigcal.errors import RecordingError
from rigcal.recording import Message, Source, open_recording, ros
from rigcal.recording.writer import RecordingWriter

SCANS = Source(topic="/front/scan")
STAMPS = [10**18 + i * 10**8 for i in range(12)]


def _number(message: Message) -> int:
    return len(message.value.ranges) - 3


def test_topics_types_and_counts(bag: Path) -> None:
    with open_recording(bag) as recording:
        assert dict(recording.contents()) == {
            "/front/scan": ("sensor_msgs/msg/LaserScan", 12),
            "/tick": ("std_msgs/msg/String", 4),
        }
        assert recording.count(SCANS) == 12
        assert recording.count(Source(topic="/tick")) == 4


def test_messages_have_type_header_stamp_and_origin(bag: Path) -> None:
    with open_recording(bag) as recording:
        messages = list(recording.read(SCANS))
    assert [_number(m) for m in messages] == list(range(12))
    assert [m.stamp_ns for m in messages] == [s - 5 for s in STAMPS]
    assert {m.type for m in messages} == {"sensor_msgs/msg/LaserScan"}
    assert all(m.exposure is None for m in messages)
    assert messages[7].origin == f"{bag.name} /front/scan #7"
    assert messages[7].value.header.frame_id == "front"
    np.testing.assert_array_equal(messages[7].value.ranges, np.arange(10, dtype=np.float32))


def test_a_message_without_header_has_its_log_time(bag: Path) -> None:
    with open_recording(bag) as recording:
        ticks = list(recording.read(Source(topic="/tick"), 1, 3))
    assert [(m.value.data, m.stamp_ns) for m in ticks] == [
        ("tick 3", STAMPS[3]),
        ("tick 6", STAMPS[6]),
    ]


SLICES = [(0, 5), (5, 9), (4, 6), (11, 12), (11, None), (3, 99), (12, None), (4, 4)]


def test_slices(bag: Path) -> None:
    with open_recording(bag) as recording:
        for first, stop in SLICES:
            messages = list(recording.read(SCANS, first, stop))
            expected = list(range(12))[first:stop]
            assert [_number(m) for m in messages] == expected
            assert [m.origin.partition("#")[2] for m in messages] == [str(i) for i in expected]


def test_two_sources_read_in_turn_do_not_disturb_each_other(bag: Path) -> None:
    with open_recording(bag) as recording:
        pairs = list(
            zip(recording.read(SCANS), recording.read(Source(topic="/tick")), strict=False)
        )
    assert [_number(scan) for scan, _ in pairs] == [0, 1, 2, 3]
    assert [tick.value.data for _, tick in pairs] == ["tick 0", "tick 3", "tick 6", "tick 9"]


def test_an_unknown_topic_lists_what_there_is(bag: Path) -> None:
    with open_recording(bag) as recording, pytest.raises(RecordingError) as error:
        recording.count(Source(topic="/front/scans"))
    text = str(error.value)
    assert "topic '/front/scans' is not in the recording, did you mean '/front/scan'?" in text
    assert "/front/scan  sensor_msgs/msg/LaserScan  12" in text
    assert "/tick  std_msgs/msg/String  4" in text


def test_a_sensor_with_files_only_is_told_to_add_its_topic(bag: Path) -> None:
    with (
        open_recording(bag) as recording,
        pytest.raises(RecordingError, match="only `files`; add `topic: NAME` to it"),
    ):
        recording.count(Source(files="*.png"))


def _worker(task: tuple[Path, int, int]) -> list[int]:
    path, first, stop = task
    with open_recording(path) as recording:
        return [_number(m) for m in recording.read(SCANS, first, stop)]


def test_a_topic_may_be_in_some_files_of_a_bag_only(make_bag: Callable[[str], Path]) -> None:
    bag = make_bag("mcap folder of two files")
    text = "std_msgs/msg/String"
    with RecordingWriter(bag / "bag_1.mcap") as writer:
        for name, stamp in (("late", STAMPS[7]), ("tock", STAMPS[9])):
            writer.write(f"/{name}", text, ros.make(text, data=name), stamp)
    with open_recording(bag) as recording:
        assert recording.count(SCANS) == 5
        assert [_number(m) for m in recording.read(SCANS)] == [0, 1, 2, 3, 4]
        (late,) = recording.read(Source(topic="/late"))
        assert (late.value.data, late.origin) == ("late", "bag /late #0")


@pytest.mark.parametrize("kind", ["mcap", "ros1", "sqlite3 folder"])
def test_several_processes_read_slices_of_one_recording(
    make_bag: Callable[[str], Path], kind: str
) -> None:
    bag = make_bag(kind)
    with (
        open_recording(bag) as recording,
        multiprocessing.get_context("fork").Pool(2) as pool,
    ):
        slices = pool.map(_worker, [(bag, first, first + 4) for first in (0, 4, 8)])
        assert recording.count(SCANS) == 12
    assert [n for part in slices for n in part] == list(range(12))


@pytest.mark.parametrize("suffix", [".mcap", ".bag"])
def test_messages_of_one_log_time_are_each_in_one_slice(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"r{suffix}"
    with RecordingWriter(path) as writer:
        for i, stamp in enumerate([10, 20, 20, 20, 20, 30]):
            message = ros.make("std_msgs/msg/String", data=str(i))
            writer.write("/t", "std_msgs/msg/String", message, stamp)
    with open_recording(path) as recording:
        parts = [
            [m.value.data for m in recording.read(Source(topic="/t"), first, first + 2)]
            for first in (0, 2, 4)
        ]
    assert parts == [["0", "1"], ["2", "3"], ["4", "5"]]


@pytest.mark.parametrize("suffix", [".mcap", ".bag"])
def test_messages_are_in_order_of_log_time_and_a_header_stamp_of_zero_is_none(
    tmp_path: Path, suffix: str
) -> None:
    path = tmp_path / f"r{suffix}"
    with RecordingWriter(path) as writer:
        for stamp in (30, 10, 20):
            message = ros.make("sensor_msgs/msg/LaserScan", ranges=np.zeros(stamp))
            writer.write("/t", "sensor_msgs/msg/LaserScan", message, stamp)
    with open_recording(path) as recording:
        messages = list(recording.read(Source(topic="/t")))
    assert [(len(m.value.ranges), m.stamp_ns) for m in messages] == [(10, 10), (20, 20), (30, 30)]


@pytest.mark.parametrize("suffix", [".mcap", ".bag"])
def test_messages_outside_the_slice_are_not_loaded(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"r{suffix}"
    rng = np.random.default_rng(0)
    with RecordingWriter(path) as writer:
        for stamp in range(1, 5):
            data = rng.integers(0, 256, 1_200_000, np.uint8)
            message = ros.make("sensor_msgs/msg/CompressedImage", data=data)
            writer.write("/t", "sensor_msgs/msg/CompressedImage", message, stamp)
    damaged = bytearray(path.read_bytes())
    start = 4_200 if suffix == ".bag" else 60
    damaged[start : start + 3000] = bytes(3000)
    path.write_bytes(bytes(damaged))
    source = Source(topic="/t")
    with open_recording(path) as recording:
        assert [m.stamp_ns for m in recording.read(source, 2)] == [3, 4]
        with pytest.raises(RecordingError, match="topic '/t' cannot be read") as error:
            list(recording.read(source))
    assert ("rosbag reindex" if suffix == ".bag" else "mcap recover") in str(error.value)


_SONAR = "acme_msgs/msg/Sonar"
_SONAR_TEXT = (
    "std_msgs/Header header\nEcho[] echoes\nuint8 KIND=3\n" + "=" * 80 + "\n"
    "MSG: acme_msgs/Echo\nfloat32 range\nuint16[4] bins\n"
)


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_a_message_type_defined_in_a_ros2_bag(tmp_path: Path, storage: StoragePlugin) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(_SONAR_TEXT, _SONAR))
    echo = store.types["acme_msgs/msg/Echo"](2.5, np.arange(4, dtype=np.uint16))
    message = store.types[_SONAR](ros.header(7, "sonar"), [echo])
    with Writer(tmp_path / "bag", version=9, storage_plugin=storage) as writer:
        connection = writer.add_connection("/sonar", _SONAR, typestore=store)
        writer.write(connection, 9, store.serialize_cdr(message, _SONAR))
    _assert_sonar(tmp_path / "bag")


def test_a_message_type_defined_in_a_ros1_bag(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(_SONAR_TEXT, _SONAR))
    echo = store.types["acme_msgs/msg/Echo"](2.5, np.arange(4, dtype=np.uint16))
    stamp = store.types["builtin_interfaces/msg/Time"](0, 7)
    header = store.types["std_msgs/msg/Header"](1, stamp, "sonar")
    with Writer1(tmp_path / "r.bag") as writer:
        connection = writer.add_connection("/sonar", _SONAR, typestore=store)
        message = store.types[_SONAR](header, [echo])
        writer.write(connection, 9, store.serialize_ros1(message, _SONAR))
    _assert_sonar(tmp_path / "r.bag")


def _assert_sonar(path: Path) -> None:
    with open_recording(path) as recording:
        (message,) = recording.read(Source(topic="/sonar"))
    assert (message.type, message.stamp_ns) == (_SONAR, 7)
    assert message.value.echoes[0].range == 2.5
    assert message.value.echoes[0].bins.tolist() == [0, 1, 2, 3]


def test_a_bag_without_definitions_is_read_with_the_standard_types(
    make_bag: Callable[[str], Path],
) -> None:
    """As ROS 2 up to Humble recorded sqlite3 bags."""
    import sqlite3

    path = make_bag("sqlite3 folder")
    with sqlite3.connect(path / "bag.db3") as database:
        database.execute("DELETE FROM message_definitions")
    database.close()
    with open_recording(path) as recording:
        assert [_number(m) for m in recording.read(SCANS, 3, 5)] == [3, 4]
    with sqlite3.connect(path / "bag.db3") as database:
        database.execute("UPDATE topics SET type = 'acme_msgs/msg/Odd' WHERE name = '/tick'")
    database.close()
    with (
        open_recording(path) as recording,
        pytest.raises(RecordingError, match="'acme_msgs/msg/Odd' is not defined in the recording"),
    ):
        list(recording.read(Source(topic="/tick")))
