from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rigcal.errors import RecordingError
from rigcal.recording.message import Message
from rigcal_lrf2d import LRF2D, Lrf2dConfig, Scan

CONFIG = Lrf2dConfig()


def laser_scan(ranges, angle_min=-0.2, step=0.1, low=0.1, high=30.0) -> Message:
    value = SimpleNamespace(
        ranges=np.array(ranges, dtype=np.float32),
        angle_min=angle_min,
        angle_increment=step,
        range_min=low,
        range_max=high,
    )
    return Message("sensor_msgs/msg/LaserScan", value, 5, None, "bag, /scan, message 3")


def file(path: Path) -> Message:
    return Message(path.suffix, path, 0, "1", str(path))


def decode(message: Message, config: Lrf2dConfig = CONFIG) -> Scan:
    scan = LRF2D.decode(message, config)
    assert isinstance(scan, Scan)
    return scan


def test_a_laser_scan_has_a_beam_per_range() -> None:
    scan = decode(laser_scan([1, 2, 3]))
    assert scan.angles == pytest.approx([-0.2, -0.1, 0.0])
    assert scan.ranges == pytest.approx([1, 2, 3])


def test_a_laser_scan_that_turns_clockwise_is_sorted() -> None:
    scan = decode(laser_scan([1, 2, 3], angle_min=0.2, step=-0.1))
    assert scan.angles == pytest.approx([0.0, 0.1, 0.2])
    assert scan.ranges == pytest.approx([3, 2, 1])


def test_what_is_no_range_is_no_return() -> None:
    scan = decode(laser_scan([np.nan, np.inf, -np.inf, 0, -1, 0.05, 31, 30, 0.1]))
    assert np.isfinite(scan.ranges).tolist() == [False] * 7 + [True] * 2


def test_limits_of_the_config_hold_too() -> None:
    scan = decode(laser_scan([1, 5, 9]), Lrf2dConfig(range_min_m=2, range_max_m=8))
    assert scan.valid.tolist() == [False, True, False]


def test_the_view_of_a_scan_is_its_returns_as_points() -> None:
    assert LRF2D.view is not None
    points = LRF2D.view(laser_scan([2, np.inf, 3], angle_min=0.0, step=np.pi / 4), CONFIG).points
    np.testing.assert_allclose(points, [[2, 0, 0], [0, 3, 0]], atol=1e-6)


def test_the_view_is_without_the_bias() -> None:
    assert LRF2D.view is not None
    config = CONFIG.model_copy(update={"range_bias_m": 0.25})
    points = LRF2D.view(laser_scan([2, 3]), config).points
    assert np.linalg.norm(points, axis=1) == pytest.approx([1.75, 2.75])


def test_a_message_without_limits_has_none() -> None:
    assert decode(laser_scan([100.0], low=0, high=0)).valid.all()


@pytest.mark.parametrize(
    ("message", "complaint"),
    [
        (laser_scan([]), "the LaserScan has no ranges"),
        (laser_scan([1, 2], step=0.0), "angle_increment 0"),
        (laser_scan([1, 2], angle_min=np.nan), "angle_min nan"),
        (laser_scan(np.ones(360), step=1.0), "expected one revolution"),
    ],
)
def test_a_message_that_is_no_scan_is_refused(message: Message, complaint: str) -> None:
    with pytest.raises(RecordingError, match=complaint) as caught:
        decode(message)
    assert "bag, /scan, message 3" in str(caught.value)


def test_a_filter_on_a_laser_scan_is_refused() -> None:
    with pytest.raises(RecordingError, match="this is a LaserScan"):
        decode(laser_scan([1]), Lrf2dConfig(filter={"ring": 8}))


POLAR = np.array([[-0.1, 2.0], [0.0, np.inf], [0.1, 2.5]])
CARTESIAN = np.array([[2.0, 0.5], [2.0, -0.5], [2.0, 0.1]])


@pytest.mark.parametrize("header", ["", "angle_rad,range_m\n", "# angle_rad, range_m\n"])
def test_csv_of_angle_and_range(tmp_path: Path, header: str) -> None:
    path = tmp_path / "1.csv"
    path.write_text(header + "\n".join(f"{a},{r}" for a, r in POLAR) + "\n")
    scan = decode(file(path))
    np.testing.assert_array_equal(scan.angles, POLAR[:, 0])
    np.testing.assert_array_equal(scan.ranges, POLAR[:, 1])


@pytest.mark.parametrize("header", ["", "x_m,y_m\n", "x_m,y_m,intensity\n"])
def test_csv_of_x_and_y(tmp_path: Path, header: str) -> None:
    path = tmp_path / "1.csv"
    more = ",7" if "intensity" in header else ""
    path.write_text(header + "\n".join(f"{x},{y}{more}" for x, y in CARTESIAN))
    scan = decode(file(path))
    assert scan.angles == pytest.approx(np.arctan2([-0.5, 0.1, 0.5], 2))
    assert scan.ranges == pytest.approx(np.hypot([-0.5, 0.1, 0.5], 2))


def test_csv_of_a_cloud_without_names(tmp_path: Path) -> None:
    path = tmp_path / "1.csv"
    path.write_text("1,0,0,50,8\n0,2,0,60,8\n0,3,1,70,9\n")
    scan = decode(file(path), Lrf2dConfig(filter={"ring": 8}))
    assert scan.ranges == pytest.approx([1, 2])


def test_npy_with_and_without_names(tmp_path: Path) -> None:
    plain, named = tmp_path / "1.npy", tmp_path / "2.npy"
    np.save(plain, POLAR)
    table = np.zeros(3, dtype=[("x_m", "f4"), ("y_m", "f4")])
    table["x_m"], table["y_m"] = CARTESIAN.T
    np.save(named, table)
    np.testing.assert_array_equal(decode(file(plain)).angles, POLAR[:, 0])
    assert decode(file(named)).ranges == pytest.approx(np.hypot([-0.5, 0.1, 0.5], 2))


@pytest.mark.parametrize("yaw", [0.0, 0.5, 1.2, 2.0])
def test_two_columns_without_names_are_told_apart(tmp_path: Path, yaw: float) -> None:
    angles = np.radians(np.arange(-45, 45, 0.5))
    ranges = 2 / np.cos(angles)
    kept = np.random.default_rng(0).uniform(size=len(angles)) < 0.8
    np.save(tmp_path / "1.npy", np.column_stack([angles + yaw, ranges])[kept])
    xy = np.column_stack([ranges * np.cos(angles + yaw), ranges * np.sin(angles + yaw)])
    np.save(tmp_path / "2.npy", xy[kept])
    polar, cartesian = (decode(file(tmp_path / name)) for name in ("1.npy", "2.npy"))
    np.testing.assert_allclose(polar.angles, cartesian.angles, atol=1e-9)
    np.testing.assert_allclose(polar.ranges, cartesian.ranges, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "has shape"),
        ("angle_rad,range_m\n", "has shape"),
        ("1,2,3,4,5,6\n", "6 columns without names"),
        ("1\n2\n", "1 columns without names"),
        ("azimuth,distance\n1,2\n", "columns azimuth, distance"),
        ("angle_rad,range_m\n1,two\n", "cannot be read as a scan"),
        ("angle_rad,range_m\n1,2\n3\n", "row 2 has 1 columns"),
        ("angle_rad,range_m\nnan,2\n", "angle is not finite"),
    ],
)
def test_a_table_that_is_no_scan_is_refused(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "1.csv"
    path.write_text(text)
    with pytest.raises(RecordingError, match=complaint) as caught:
        decode(file(path))
    assert str(path) in str(caught.value)


def test_a_broken_npy_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "1.npy"
    path.write_bytes(b"\x93NUMPY nonsense")
    with pytest.raises(RecordingError, match="cannot be read as a scan"):
        decode(file(path))


def pcd(tmp_path: Path, rows: list[tuple[float, ...]]) -> Message:
    path = tmp_path / "1.pcd"
    head = "VERSION 0.7\nFIELDS x y z ring\nSIZE 4 4 4 2\nTYPE F F F U\nCOUNT 1 1 1 1\n"
    size = f"WIDTH {len(rows)}\nHEIGHT 1\nPOINTS {len(rows)}\nDATA ascii\n"
    path.write_text(head + size + "\n".join(" ".join(f"{v:g}" for v in row) for row in rows) + "\n")
    return file(path)


CLOUD = [(1, 0, 0, 8), (0, 2, 0, 8), (0, 3, 1, 9), (np.nan, 0, 0, 8), (0, -1, -1, 7)]


def test_x_and_y_of_the_points_of_one_ring_are_a_scan(tmp_path: Path) -> None:
    scan = decode(pcd(tmp_path, CLOUD), Lrf2dConfig(filter={"ring": 8}))
    assert scan.angles == pytest.approx([0, np.pi / 2])
    assert scan.ranges == pytest.approx([1, 2])


def test_a_filter_may_give_limits(tmp_path: Path) -> None:
    config = Lrf2dConfig(filter={"ring": (8, 9), "z": (-0.1, 0.1)})
    assert decode(pcd(tmp_path, CLOUD), config).ranges == pytest.approx([1, 2])


@pytest.mark.parametrize(
    ("wanted", "complaint"),
    [
        ({"channel": 8}, "names the field 'channel', but the points have x, y, z, ring"),
        ({"ring": 12}, "keeps none of the 20 points; ring goes from 7 to 9"),
        ({"ring": (12, 13)}, "keeps none of the 20 points; ring goes from 7 to 9"),
        ({"ring": 9, "z": 0}, "keeps none of the 20 points; z goes from -1 to 1"),
        ({}, "between -45.0 and 18.4 deg of elevation"),
    ],
)
def test_a_cloud_that_gives_no_scan_is_refused(tmp_path: Path, wanted, complaint: str) -> None:
    rows = [*(row for row in CLOUD if row[0] == row[0])]
    rows = [row for row in rows for _ in range(5)]
    with pytest.raises(RecordingError, match=complaint):
        decode(pcd(tmp_path, rows), Lrf2dConfig(filter=wanted))


def test_an_empty_cloud_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError):
        decode(pcd(tmp_path, []))
