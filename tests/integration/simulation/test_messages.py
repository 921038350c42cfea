"""A simulated recording, field by field against the message definitions, by an independent reader.

What `ros2 bag info` and Foxglove need is in the MCAP's header and summary.
"""

from __future__ import annotations

from collections import defaultdict
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag1 import Reader as BagReader

from rigcal import Registry, load_calibration, load_rig
from rigcal.rig import T_root_sensors
from rigcal_sim.dataset import Summary, simulate
from rigcal_sim.scenario_file import load_scenario

SECOND = 10**9


@pytest.fixture(scope="module")
def summary(
    rig_file: Path, scenario_file: Path, tmp_path_factory: pytest.TempPathFactory
) -> Summary:
    registry = Registry.from_entry_points()
    rig = load_rig(rig_file, registry)
    scenario = load_scenario(scenario_file, rig, registry)
    out = tmp_path_factory.mktemp("recording")
    return simulate(rig, registry, scenario, 3, out, ("mcap", "bag"), jobs=1)


@pytest.fixture(scope="module")
def reader(summary: Summary) -> Any:
    content = BytesIO(summary.recordings[0].read_bytes())
    return make_reader(content, validate_crcs=True, decoder_factories=[DecoderFactory()])


@pytest.fixture(scope="module")
def messages(reader: Any) -> dict[str, list[tuple[int, Any]]]:
    """(log time, message) by topic."""
    found = defaultdict(list)
    for _, channel, message, decoded in reader.iter_decoded_messages():
        found[channel.topic].append((message.log_time, decoded))
    return dict(found)


def test_the_mcap_has_the_profile_and_the_summary_of_a_ros2_bag(
    reader: Any, summary: Summary
) -> None:
    assert reader.get_header().profile == "ros2"
    index = reader.get_summary()
    assert {s.name: s.encoding for s in index.schemas.values()} == dict.fromkeys(
        [
            "sensor_msgs/msg/CameraInfo",
            "sensor_msgs/msg/CompressedImage",
            "sensor_msgs/msg/Image",
            "sensor_msgs/msg/LaserScan",
            "sensor_msgs/msg/PointCloud2",
            "tf2_msgs/msg/TFMessage",
        ],
        "ros2msg",
    )
    assert {c.message_encoding for c in index.channels.values()} == {"cdr"}
    counts = {
        index.channels[i].topic: n for i, n in index.statistics.channel_message_counts.items()
    }
    assert counts == summary.messages
    assert index.statistics.message_count == sum(counts.values())
    assert index.statistics.chunk_count == len(index.chunk_indexes) > 0
    assert all(chunk.message_index_offsets for chunk in index.chunk_indexes)


def test_the_mcap_carries_the_metadata_that_ros2_bag_info_prints(
    reader: Any, summary: Summary
) -> None:
    (record,) = reader.iter_metadata()
    assert record.name == "rosbag2"
    info = yaml.safe_load(record.metadata["serialized_metadata"])
    assert info["storage_identifier"] == "mcap"
    assert info["relative_file_paths"] == ["recording.mcap"]
    assert info["message_count"] == sum(summary.messages.values())
    topics = info["topics_with_message_count"]
    assert {t["topic_metadata"]["name"]: t["message_count"] for t in topics} == summary.messages
    assert {t["topic_metadata"]["serialization_format"] for t in topics} == {"cdr"}


def test_messages_are_in_the_order_of_their_stamps(
    messages: dict[str, list[tuple[int, Any]]], reader: Any
) -> None:
    times = [message.log_time for _, _, message in reader.iter_messages(log_time_order=False)]
    assert times == sorted(times)
    for topic, found in messages.items():
        for time, message in found:
            header = message.transforms[0].header if topic == "/tf_static" else message.header
            assert header.stamp.sec * SECOND + header.stamp.nanosec == time


def test_sensors_run_at_their_rates(messages: dict[str, list[tuple[int, Any]]]) -> None:
    for topic, period_s in (("/front/scan", 0.1), ("/cam/image_raw", 0.5), ("/lidar/points", 0.5)):
        stamps = [time / SECOND for time, _ in messages[topic]]
        assert all(abs(b - a - period_s) < 0.0101 for a, b in pairwise(stamps)), topic
    start = messages["/cam/image_raw"][0][0]
    assert messages["/lidar/points"][0][0] - start == pytest.approx(0.23 * SECOND, abs=0.011e9)


def test_frames_are_those_of_the_true_transforms(
    messages: dict[str, list[tuple[int, Any]]], rig_file: Path
) -> None:
    rig = load_rig(rig_file, Registry.from_entry_points())
    ((_, tf),) = messages["/tf_static"]
    found = {t.child_frame_id: t for t in tf.transforms}
    assert set(found) == set(rig.sensors) - {"front"}
    for name, T in T_root_sensors(rig).items():
        if name != "front":
            t = found[name].transform.translation
            assert found[name].header.frame_id == "front"
            np.testing.assert_allclose([t.x, t.y, t.z], T[:3, 3], atol=1e-12)
    frames = {
        topic: m.header.frame_id
        for topic, ((_, m), *_) in messages.items()
        if topic != "/tf_static"
    }
    assert frames == {
        "/cam/camera_info": "cam",
        "/cam/image_raw": "cam",
        "/front/scan": "front",
        "/lidar/points": "lidar",
        "/wide/camera_info": "wide",
        "/wide/image_raw": "wide",
    }


def test_an_image_has_the_bytes_that_its_fields_say(
    messages: dict[str, list[tuple[int, Any]]],
) -> None:
    for _, image in messages["/cam/image_raw"]:
        assert (image.width, image.height, image.encoding) == (320, 240, "mono8")
        assert image.step == 320
        assert len(image.data) == image.step * image.height
        assert image.is_bigendian == 0
    for _, image in messages["/wide/image_raw"]:
        pixels = cv2.imdecode(np.frombuffer(image.data, np.uint8), cv2.IMREAD_UNCHANGED)
        assert "jpeg" in image.format
        assert np.asarray(pixels).shape == (200, 240)


def test_camera_info_belongs_to_its_image_and_its_lens_model(
    messages: dict[str, list[tuple[int, Any]]],
) -> None:
    for camera, model, d in (
        ("cam", "plumb_bob", [-0.1, 0.01, 0.001, 0.0, 0.0]),
        ("wide", "equidistant", [0.01, 0.0, 0.0, 0.0]),
    ):
        infos = messages[f"/{camera}/camera_info"]
        assert [time for time, _ in infos] == [time for time, _ in messages[f"/{camera}/image_raw"]]
        _, info = infos[0]
        assert info.distortion_model == model
        assert list(info.d) == d
        K, P = np.reshape(info.k, (3, 3)), np.reshape(info.p, (3, 4))
        np.testing.assert_array_equal(P, np.column_stack([K, np.zeros(3)]))
        np.testing.assert_array_equal(np.reshape(info.r, (3, 3)), np.eye(3))
        assert K[2].tolist() == [0, 0, 1]
    _, info = messages["/cam/camera_info"][0]
    assert (info.width, info.height) == (320, 240)
    assert info.k == [200.0, 0.0, 159.5, 0.0, 201.0, 119.5, 0.0, 0.0, 1.0]


def test_a_laser_scan_agrees_with_itself(messages: dict[str, list[tuple[int, Any]]]) -> None:
    for _, scan in messages["/front/scan"]:
        ranges = np.array(scan.ranges)
        assert len(ranges) == 181
        last = scan.angle_min + 180 * scan.angle_increment
        assert last == pytest.approx(scan.angle_max, abs=1e-6)
        assert scan.angle_max == pytest.approx(np.pi / 2, abs=1e-6)
        assert (scan.range_min, scan.range_max) == (pytest.approx(0.1), pytest.approx(3.0))
        # REP 117: beams without return are infinite, not at the end of the range.
        good = (ranges >= scan.range_min) & (ranges <= scan.range_max)
        assert np.all(good | (ranges == np.inf))
        assert 0 < np.count_nonzero(good) < 181
        # All beams at the stamp: motion within a scan is not simulated.
        assert scan.time_increment == scan.scan_time == 0.0
        assert len(scan.intensities) in (0, 181)


def test_a_point_cloud_agrees_with_itself(messages: dict[str, list[tuple[int, Any]]]) -> None:
    for _, cloud in messages["/lidar/points"]:
        assert [(f.name, f.datatype, f.count) for f in cloud.fields][:3] == [
            ("x", 7, 1), ("y", 7, 1), ("z", 7, 1),
        ]  # fmt: skip
        sizes = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 8: 8}
        ends = [f.offset + sizes[f.datatype] * f.count for f in cloud.fields]
        starts = [f.offset for f in cloud.fields]
        assert starts[0] == 0
        assert all(end <= start for end, start in zip(ends, starts[1:], strict=False))
        assert ends[-1] <= cloud.point_step
        assert cloud.row_step == cloud.point_step * cloud.width
        assert len(cloud.data) == cloud.row_step * cloud.height
        rows = np.frombuffer(bytes(cloud.data), np.uint8).reshape(-1, cloud.point_step)
        points = np.ascontiguousarray(rows[:, :12]).view("<f4")
        assert cloud.is_dense == bool(np.isfinite(points).all())
        assert not cloud.is_bigendian


def test_the_bag_holds_the_same(summary: Summary) -> None:
    with BagReader(summary.recordings[1]) as bag:
        counts = {connection.topic: connection.msgcount for connection in bag.connections}
        times = [time for _, time, _ in bag.messages()]
    assert counts == summary.messages
    assert times == sorted(times)


def test_truth_tells_where_the_board_was_held_and_when(
    summary: Summary, messages: dict[str, list[tuple[int, Any]]]
) -> None:
    truth = load_calibration(summary.truth)
    assert list(truth.target_poses) == list(truth.holds_ns) == ["0000", "0001"]
    (first, first_end), (second, second_end) = truth.holds_ns.values()
    assert first == 1_600_000_000 * SECOND
    assert first_end - first == second_end - second == SECOND // 2

    scans = messages["/front/scan"]

    def most_moved(start: int, end: int) -> float:
        """Tenth largest change of a range from scan to scan."""
        ranges = np.array([scan.ranges for time, scan in scans if start < time < end])
        ranges[~np.isfinite(ranges)] = 3.0
        return float(np.sort(np.abs(np.diff(ranges, axis=0)), axis=None)[-10])

    assert most_moved(first, first_end) < 0.05
    assert most_moved(first_end, second) > 0.2
