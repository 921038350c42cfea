import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from rigcal.errors import RecordingError
from rigcal.recording.cloud import cloud_message
from rigcal.recording.message import Message
from rigcal_lrf3d import LRF3D, Cloud, Lrf3dConfig

COLUMNS: dict[str, np.ndarray] = {
    "x": np.array([1.0, 2.0, np.nan, 0.0, 4.0], np.float32),
    "y": np.array([0.0, 1.0, 1.0, 0.0, 1.0], np.float32),
    "z": np.array([0.0, 1.0, 1.0, 0.0, np.inf], np.float32),
    "ring": np.array([3, 8, 8, 8, 8], np.uint16),
}


def message(columns: dict[str, np.ndarray]) -> Message:
    value = cloud_message(columns, 5, "lidar")
    return Message("sensor_msgs/msg/PointCloud2", value, 5, None, "bag, message 3")


def test_points_that_are_no_returns_are_left_out() -> None:
    cloud = LRF3D.decode(message(COLUMNS), Lrf3dConfig())
    np.testing.assert_array_equal(cloud.points, [[1, 0, 0], [2, 1, 1]])


@pytest.mark.parametrize("ring", [8, [7, 9]])
def test_a_filter_keeps_part_of_the_cloud(ring: object) -> None:
    config = Lrf3dConfig.model_validate({"filter": {"ring": ring}})
    np.testing.assert_array_equal(LRF3D.decode(message(COLUMNS), config).points, [[2, 1, 1]])


def test_ranges_limit_the_cloud() -> None:
    config = Lrf3dConfig(range_min_m=0.5, range_max_m=2.0)
    np.testing.assert_array_equal(LRF3D.decode(message(COLUMNS), config).points, [[1, 0, 0]])


def test_clouds_are_read_from_files(tmp_path: Path) -> None:
    path = tmp_path / "pose1.csv"
    path.write_text("x,y,z\n1.0,2.0,3.0\nnan,0,0\n")
    cloud = LRF3D.decode(Message(".csv", path, 0, "1", "pose1.csv"), Lrf3dConfig())
    np.testing.assert_array_equal(cloud.points, [[1, 2, 3]])


@pytest.mark.parametrize(
    ("columns", "wanted", "text"),
    [
        (("x", "y"), {}, "bag, message 3: .*x, y.*expected x, y and z"),
        (("x", "y", "z"), {"ring": 8}, "'ring', but the points have x, y, z"),
        (("x", "y", "z", "ring"), {"ring": 9}, "keeps none of the 5 points; ring goes from 3 to 8"),
    ],
)
def test_clouds_that_cannot_be_used_are_refused(
    columns: tuple[str, ...], wanted: dict[str, float], text: str
) -> None:
    config = Lrf3dConfig.model_validate({"filter": wanted})
    with pytest.raises(RecordingError, match=text):
        LRF3D.decode(message({name: COLUMNS[name] for name in columns}), config)


def test_what_is_encoded_is_decoded() -> None:
    points = np.random.default_rng(1).normal(size=(50, 3)).astype(np.float32).astype(float)
    assert LRF3D.encode is not None
    value = LRF3D.encode(Cloud(points), Lrf3dConfig(), 7, "lidar")
    assert LRF3D.message_type is not None
    sent = Message(LRF3D.message_type, value, 7, None, "here")
    np.testing.assert_array_equal(LRF3D.decode(sent, Lrf3dConfig()).points, points)
    assert LRF3D.view is not None
    seen = LRF3D.view(sent, Lrf3dConfig(range_max_m=1.0)).points
    np.testing.assert_array_equal(seen, points[np.linalg.norm(points, axis=1) <= 1.0])


def test_the_view_is_without_the_bias() -> None:
    assert LRF3D.view is not None
    seen = LRF3D.view(message(COLUMNS), Lrf3dConfig(range_bias_m=0.5)).points
    np.testing.assert_allclose(np.linalg.norm(seen, axis=1), [0.5, np.sqrt(6) - 0.5])


def test_importing_the_plugin_imports_nothing_heavy() -> None:
    code = "import rigcal_lrf3d, sys; print({'open3d', 'scipy', 'libusb_package'} & {*sys.modules})"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"
