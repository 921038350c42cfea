from __future__ import annotations

import errno
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from rosbags.interfaces import ConnectionExtRosbag1, ConnectionExtRosbag2, QosDurability
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Reader as Reader2
from rosbags.rosbag2 import Writer as Writer2

from rigcal.errors import RecordingError
from rigcal.geometry import se3
from rigcal.recording import Source, open_recording, ros
from rigcal.recording.writer import RecordingWriter

INFO = "sensor_msgs/msg/CameraInfo"
SUFFIXES = pytest.mark.parametrize("suffix", [".mcap", ".bag"])


def _write(path: Path) -> Path:
    T_lidar_cam0 = se3.exp(np.array([0.1, 0.2, 0.3, 1.0, 2.0, 3.0]))
    with RecordingWriter(path) as writer:
        tf = ros.tf_static({"cam0": ("lidar", T_lidar_cam0)}, 1)
        writer.write("/tf_static", ros.TF_TYPE, tf, 1)
        for stamp in (10, 20):
            info = ros.make(INFO, header=ros.header(stamp, "cam0"), d=[0.1], k=np.eye(3) * stamp)
            writer.write("/cam0/camera_info", INFO, info, stamp)
    return path


@SUFFIXES
def test_the_same_messages_give_the_same_bytes(tmp_path: Path, suffix: str) -> None:
    first = _write(tmp_path / "a" / f"r{suffix}").read_bytes()
    assert _write(tmp_path / "b" / f"r{suffix}").read_bytes() == first


@SUFFIXES
def test_messages_keep_their_content(tmp_path: Path, suffix: str) -> None:
    with open_recording(_write(tmp_path / f"r{suffix}")) as recording:
        infos = [m.value for m in recording.read(Source(topic="/cam0/camera_info"))]
        (tf,) = recording.read(Source(topic="/tf_static"))
    # ROS 1 names them in capitals.
    k = [getattr(i, "k", None) if suffix == ".mcap" else i.K for i in infos]
    np.testing.assert_array_equal(k, [np.eye(3).ravel() * 10, np.eye(3).ravel() * 20])
    (transform,) = tf.value.transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("lidar", "cam0")
    q = transform.transform.rotation
    np.testing.assert_allclose(
        se3.rotation_from_quaternion(np.array([q.x, q.y, q.z, q.w])),
        se3.exp_so3(np.array([0.1, 0.2, 0.3])),
        atol=1e-12,
    )


def test_a_ros1_bag_has_the_definitions_and_sums_of_ros1(tmp_path: Path) -> None:
    with Reader1(_write(tmp_path / "r.bag")) as reader:
        by_topic = {c.topic: c for c in reader.connections}
        seqs = [
            ros.ros1_typestore().deserialize_ros1(data, c.msgtype).header.seq  # type: ignore[attr-defined]
            for c, _, data in reader.messages([by_topic["/cam0/camera_info"]])
        ]
    # As `rosmsg md5` prints them.
    assert by_topic["/cam0/camera_info"].digest == "c9a58c1b0b154e0e6da7578cb991d214"
    assert by_topic["/tf_static"].digest == "94810edda583a504dfda3829e70d7eec"
    assert "uint32 seq" in by_topic["/cam0/camera_info"].msgdef.data
    tf = by_topic["/tf_static"].ext
    assert isinstance(tf, ConnectionExtRosbag1)
    assert tf.latching == 1
    assert seqs == [0, 1]


def test_an_mcap_has_the_profile_and_the_definitions_of_ros2(tmp_path: Path) -> None:
    content = _write(tmp_path / "r.mcap").read_bytes()
    assert content[17:25] == b"\x04\x00\x00\x00ros2"
    assert b"ros2msg" in content
    assert b"MSG: sensor_msgs/RegionOfInterest" in content
    with Reader2(tmp_path / "r.mcap") as reader:
        (tf,) = (c for c in reader.connections if c.topic == "/tf_static")
    assert isinstance(tf.ext, ConnectionExtRosbag2)
    assert tf.ext.offered_qos_profiles[0].durability == QosDurability.TRANSIENT_LOCAL


@SUFFIXES
def test_nothing_is_left_of_a_recording_that_was_interrupted(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"r{suffix}"
    path.write_bytes(b"an older recording")
    message = ros.make("std_msgs/msg/String", data="x")
    with suppress(KeyboardInterrupt), RecordingWriter(path) as writer:
        writer.write("/t", "std_msgs/msg/String", message, 1)
        raise KeyboardInterrupt
    assert path.read_bytes() == b"an older recording"
    assert list(tmp_path.iterdir()) == [path]
    with RecordingWriter(path) as writer:
        writer.write("/t", "std_msgs/msg/String", message, 1)
    assert path.read_bytes() != b"an older recording"
    assert list(tmp_path.iterdir()) == [path]


@SUFFIXES
def test_a_topic_has_one_type(tmp_path: Path, suffix: str) -> None:
    with RecordingWriter(tmp_path / f"r{suffix}") as writer:
        writer.write("/t", "std_msgs/msg/String", ros.make("std_msgs/msg/String"), 1)
        with pytest.raises(RecordingError, match="'/t' carries std_msgs/msg/String, not std_msgs"):
            writer.write("/t", "std_msgs/msg/Int32", ros.make("std_msgs/msg/Int32"), 2)


@SUFFIXES
def test_a_message_that_does_not_fit_its_type(tmp_path: Path, suffix: str) -> None:
    with RecordingWriter(tmp_path / f"r{suffix}") as writer:
        with pytest.raises(RecordingError, match="is not a message type of ROS 2 Humble"):
            writer.write("/t", "acme_msgs/msg/Sonar", ros.make("std_msgs/msg/String"), 1)
        with pytest.raises(RecordingError, match=r"r\.\w+: /u: "):
            writer.write("/u", INFO, ros.make("std_msgs/msg/String"), 1)
        with pytest.raises(RecordingError, match="stamp -1 ns is negative"):
            writer.write("/u", INFO, ros.make(INFO), -1)


def test_a_type_that_ros1_does_not_have(tmp_path: Path) -> None:
    kind = next(k for k in ros.typestore().fielddefs if k not in ros.ros1_typestore().fielddefs)
    with (
        pytest.raises(RecordingError, match="is not a message type of ROS 1: write an MCAP"),
        RecordingWriter(tmp_path / "r.bag") as writer,
    ):
        writer.write("/t", kind, ros.make(kind), 1)


def test_places_and_formats_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"is written as \.mcap or \.bag, not as '.db3'"):
        RecordingWriter(tmp_path / "r.db3")
    (tmp_path / "file").touch()
    with (
        pytest.raises(RecordingError, match="cannot be written"),
        RecordingWriter(tmp_path / "file" / "r.mcap"),
    ):
        pass
    writer = RecordingWriter(tmp_path / "r.mcap")
    with pytest.raises(RecordingError, match="not open for writing"):
        writer.write("/t", "std_msgs/msg/String", ros.make("std_msgs/msg/String"), 1)


@SUFFIXES
def test_nothing_is_left_of_a_recording_that_cannot_be_put_in_its_place(
    tmp_path: Path, suffix: str
) -> None:
    path = tmp_path / f"r{suffix}"
    path.mkdir()
    with (
        pytest.raises(RecordingError, match=rf"r\{suffix}: cannot be written: Is a directory"),
        RecordingWriter(path) as writer,
    ):
        writer.write("/t", "std_msgs/msg/String", ros.make("std_msgs/msg/String"), 1)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(("suffix", "library"), [(".mcap", Writer2), (".bag", Writer1)])
def test_a_full_disk_is_told_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, library: type
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(library, "write", full)
    with (
        pytest.raises(RecordingError, match=rf"r\{suffix}: cannot be written: No space left on"),
        RecordingWriter(tmp_path / f"r{suffix}") as writer,
    ):
        writer.write("/t", "std_msgs/msg/String", ros.make("std_msgs/msg/String"), 1)
    assert list(tmp_path.iterdir()) == []


def test_messages_are_made_with_zeros_and_converted_arrays() -> None:
    info = ros.make(INFO, header=ros.header(3 * 10**9 + 5, "cam0"), k=range(9), height=4)
    assert info.k.dtype == np.float64
    assert info.k.tolist() == list(range(9))
    assert (info.p.shape, info.d.shape, info.width, info.distortion_model) == ((12,), (0,), 0, "")
    assert (info.header.stamp.sec, info.header.stamp.nanosec) == (3, 5)


def test_a_message_is_not_made_of_unknown_names_or_wrong_sizes() -> None:
    with pytest.raises(RecordingError, match=r"CameraInfo has no field 'K' \(has: header, height"):
        ros.make(INFO, K=np.eye(3))
    with pytest.raises(RecordingError, match=r"CameraInfo\.k: 4 numbers, expected 9"):
        ros.make(INFO, k=np.eye(2))
    with pytest.raises(RecordingError, match="'sensor_msgs/Image' is not a message type of ROS 2"):
        ros.make("sensor_msgs/Image")
