"""Whatever is wrong with a bag is said in one RecordingError."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.storage_mcap import McapReader

from rigcal.errors import RecordingError
from rigcal.recording import Source, open_recording, ros
from rigcal.recording.writer import RecordingWriter

SCANS = Source(topic="/front/scan")


def _error(path: Path) -> str | None:
    """What is said when all scans are read."""
    try:
        with open_recording(path) as recording:
            assert len(list(recording.read(SCANS))) > 0
    except RecordingError as error:
        return str(error)
    return None


def test_a_missing_path(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"none\.mcap: there is no such file or folder"):
        open_recording(tmp_path / "none.mcap")


def test_a_file_of_another_kind(tmp_path: Path) -> None:
    (tmp_path / "film.mp4").write_bytes(b"film")
    with pytest.raises(RecordingError, match=r"a '.mp4' file is not a recording; expected a fold"):
        open_recording(tmp_path / "film.mp4")


@pytest.mark.parametrize(
    ("suffix", "says"),
    [
        (".mcap", "does not begin like an MCAP file"),
        (".bag", "does not begin like a ROS 1 bag"),
        (".db3", "cannot be opened"),
    ],
)
def test_another_file_under_the_suffix_of_a_bag(tmp_path: Path, suffix: str, says: str) -> None:
    (tmp_path / f"r{suffix}").write_bytes(b"something else entirely" * 300)
    with pytest.raises(RecordingError, match=says):
        open_recording(tmp_path / f"r{suffix}")


@pytest.mark.parametrize("suffix", [".mcap", ".bag", ".db3"])
def test_an_empty_file(tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"r{suffix}").touch()
    with pytest.raises(RecordingError, match=r"cannot be opened"):
        open_recording(tmp_path / f"r{suffix}")


def _images(path: Path) -> Path:
    """20 messages of 200 kB."""
    rng = np.random.default_rng(0)
    with RecordingWriter(path) as writer:
        for i in range(1, 21):
            data = rng.integers(0, 256, 200_000, np.uint8)
            message = ros.make("sensor_msgs/msg/CompressedImage", data=data)
            writer.write("/front/scan", "sensor_msgs/msg/CompressedImage", message, i)
    return path


def test_a_truncated_mcap_says_what_can_be_kept(tmp_path: Path) -> None:
    path = _images(tmp_path / "r.mcap")
    path.write_bytes(path.read_bytes()[:3_000_000])
    with pytest.raises(RecordingError) as error:
        open_recording(path)
    assert "it breaks off: 2.4 of 3 MB with 12 messages can be read" in str(error.value)
    assert "mcap recover r.mcap -o mended.mcap" in str(error.value)


def test_an_mcap_that_ends_within_the_head_of_a_record(make_bag: Callable[[str], Path]) -> None:
    path = make_bag("mcap without index")
    closing, footer, end_of_data = 8, 9 + 20, 9 + 4
    path.write_bytes(path.read_bytes()[: -closing - footer - end_of_data + 4])
    error = _error(path) or ""
    assert "with 16 messages can be read, keep them with `mcap recover recording.mcap" in error


def test_a_file_that_goes_away_while_it_is_read(make_bag: Callable[[str], Path]) -> None:
    path = make_bag("mcap without index")
    with open_recording(path) as recording:
        path.unlink()
        with pytest.raises(RecordingError, match=r"cannot be read: .*No such file or directory$"):
            list(recording.read(SCANS))


def test_a_truncated_ros1_bag_says_what_can_be_kept(tmp_path: Path) -> None:
    path = _images(tmp_path / "r.bag")
    path.write_bytes(path.read_bytes()[:3_000_000])
    with pytest.raises(RecordingError) as error:
        open_recording(path)
    assert "2.41 of 3 MB with 2 chunks and 12 indexed messages can be read" in str(error.value)
    assert "rosbag reindex r.bag" in str(error.value)


@pytest.mark.parametrize(
    "kind",
    ["mcap", "mcap without index", "ros1", "ros1 bz2", "db3", "sqlite3 folder", "mcap folder"],
)
def test_no_truncation_lets_another_error_out(make_bag: Callable[[str], Path], kind: str) -> None:
    bag = make_bag(kind)
    path = max(bag.iterdir(), key=lambda p: p.stat().st_size) if bag.is_dir() else bag
    whole = path.read_bytes()
    for length in np.linspace(0, len(whole) - 1, 12).astype(int):
        path.write_bytes(whole[:length])
        error = _error(bag)
        # SQLite does not need the last page of every file.
        assert error is not None or path.suffix == ".db3"
        assert error is None or str(bag) in error


@pytest.mark.parametrize("kind", ["mcap", "mcap without index", "ros1", "ros1 bz2", "db3"])
def test_no_garbled_byte_lets_another_error_out(make_bag: Callable[[str], Path], kind: str) -> None:
    path = make_bag(kind)
    whole = path.read_bytes()
    rng = np.random.default_rng(1)
    for _ in range(25):
        garbled = bytearray(whole)
        for position in rng.integers(0, len(whole), 3):
            garbled[position] = int(rng.integers(256))
        path.write_bytes(bytes(garbled))
        error = _error(path)
        assert error is None or str(path) in error


def test_an_mcap_of_another_profile(make_unindexed: Callable[[str], Path]) -> None:
    with pytest.raises(RecordingError, match=r"its profile is 'ros1': give the \.bag that it was"):
        open_recording(make_unindexed("ros1"))


def test_a_bag_folder_whose_file_is_gone(make_bag: Callable[[str], Path]) -> None:
    path = make_bag("sqlite3 folder")
    (path / "bag.db3").unlink()
    with pytest.raises(RecordingError, match=r"missing.*`ros2 bag reindex bag`"):
        open_recording(path)


def test_a_bag_folder_without_metadata_is_told_to_be_reindexed(
    make_bag: Callable[[str], Path],
) -> None:
    path = make_bag("mcap folder")
    (path / "metadata.yaml").unlink()
    with (
        open_recording(path) as recording,
        pytest.raises(
            RecordingError, match=r"holds bag\.mcap: give that file .*`ros2 bag reindex`"
        ),
    ):
        recording.count(SCANS)


@pytest.mark.parametrize("suffix", [".mcap", ".bag"])
def test_a_bag_without_messages(tmp_path: Path, suffix: str) -> None:
    with RecordingWriter(tmp_path / f"r{suffix}"):
        pass
    with (
        open_recording(tmp_path / f"r{suffix}") as recording,
        pytest.raises(RecordingError, match=r"'/front/scan' is not in the .*; it holds no topics"),
    ):
        recording.count(SCANS)


def test_a_topic_of_two_types_or_of_no_messages_is_named(tmp_path: Path) -> None:
    store = ros.typestore()
    writer = Writer(tmp_path / "bag", version=8, storage_plugin=StoragePlugin.MCAP)
    with writer:
        for topic, kind in (("/t", "String"), ("/t", "Bool"), ("/u", "Bool")):
            writer.add_connection(topic, f"std_msgs/msg/{kind}", typestore=store)
    with open_recording(tmp_path / "bag") as recording:
        with pytest.raises(
            RecordingError, match=r"several message types \(std_msgs/msg/Bool, std_"
        ):
            recording.count(Source(topic="/t"))
        with pytest.raises(RecordingError, match="topic '/u' has no messages; it holds:"):
            recording.count(Source(topic="/u"))


def test_a_damaged_index_of_a_chunk_is_named_with_its_cure(make_bag: Callable[[str], Path]) -> None:
    path = make_bag("mcap")
    reader = McapReader(path)
    reader.open()
    offset = min(reader.chunks[0].message_index_offsets.values())
    reader.close()
    content = bytearray(path.read_bytes())
    content[offset] = 0x0A
    path.write_bytes(content)
    assert "is damaged; rebuild it with `mcap recover" in (_error(path) or "")


def test_an_index_of_a_chunk_that_is_too_short_is_named_with_its_cure(
    make_bag: Callable[[str], Path],
) -> None:
    path = make_bag("mcap")
    reader = McapReader(path)
    reader.open()
    offsets = reader.chunks[0].message_index_offsets
    (scans,) = (c for c in reader.connections if c.topic == "/front/scan")
    reader.close()
    content = bytearray(path.read_bytes())
    size_at = offsets[scans.id] + 11  # after the record's op, its length, and the channel
    assert content[size_at] == 12 * 16
    content[size_at] = 16
    path.write_bytes(content)
    error = _error(path) or ""
    assert "the index of topic '/front/scan' has 1 of its 12 messages; rebuild it with" in error


def test_a_record_of_an_mcap_that_is_shorter_than_its_kind_is_a_damaged_file(
    make_bag: Callable[[str], Path],
) -> None:
    path = make_bag("mcap")
    content = bytearray(path.read_bytes())
    content[9:17] = (2).to_bytes(8, "little")  # the length of the header, after magic and op
    path.write_bytes(content[:-20])
    assert (_error(path) or "").startswith(f"{path}: cannot be opened: ")
