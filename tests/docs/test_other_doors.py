"""The plugin of docs/guide/other-doors.md works as the page says."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rigcal
from rigcal.calibration import Calibration, SensorResult
from rigcal.geometry import se3
from rigcal.observation import PoseGeometry
from rigcal.rig import build_targets

POSE = se3.transform(se3.rotation_from_rpy(np.array([0.1, -0.2, 0.3])), np.array([0.3, 0.4, 0.0]))


@pytest.fixture
def followed(desk: Any, page: Any) -> Any:
    sensors = {"lidar": SensorResult("lidar", np.eye(4)), "cam": SensorResult("lidar", POSE)}
    rigcal.save_calibration(desk.folder / "calibration.yaml", Calibration("lidar", sensors))
    return desk.follow(page("guide/other-doors.md"))


def test_all_offers_are_listed_and_used(followed: Any) -> None:
    for offer in (
        "target type circles", "recording format carmen", "exporter table", "command distances",
    ):  # fmt: skip
        assert offer in followed.printed
    assert "lidar to cam: 0.500 m" in followed.printed
    table = (followed.folder / "sensors.csv").read_text().splitlines()
    header, root, cam = csv.reader(table)
    assert header[0] == "sensor in lidar"
    assert [float(v) for v in root[1:]] == [0, 0, 0, 0, 0, 0, 1]
    t, q = np.array(cam[1:4], float), np.array(cam[4:], float)
    np.testing.assert_allclose(se3.transform(se3.rotation_from_quaternion(q), t), POSE, atol=1e-12)
    assert (followed.folder / "board.pdf").read_bytes().startswith(b"%PDF")


@pytest.fixture
def installed(desk: Any, page: Any) -> Any:
    """The page's files, and its plugin installed."""
    desk.write(page("guide/other-doors.md"))
    desk.install(desk.folder / "rigcal-acme")
    return desk


def test_a_camera_finds_the_circles_in_a_simulated_image(installed: Any) -> None:
    from rigcal.scene import Scene

    registry = rigcal.Registry.from_entry_points()
    rig = rigcal.load_rig("rig.yaml", registry)
    target, camera = build_targets(rig, registry)["board"], registry.sensor_type("camera")
    config, rng = rig.sensors["cam"], np.random.default_rng(0)
    for roll, pitch, yaw in ((0.0, 0.0, 0.0), (0.4, 0.3, 2.0), (-0.3, 0.5, 4.0)):
        R = se3.rotation_from_rpy(np.array([np.pi + roll, pitch, yaw]))
        T_s_t = se3.transform(R, np.array([0.05, -0.03, 1.1]))
        scene = Scene(target, T_s_t)
        frame = camera.simulate(np.eye(4), scene, config, rng, camera.effects())
        (found, *_) = camera.detect(frame, config, target).candidates
        assert isinstance(found.geometry, PoseGeometry)
        error = se3.inverse(found.geometry.T_s_t) @ T_s_t
        assert np.linalg.norm(error[:3, 3]) < 0.003
        assert se3.rotation_angle(error[:3, :3]) < 0.005


def _line(topic: str, stamp: float, ranges: list[float]) -> str:
    words = [topic, 0, -1.5, 3.0, 0.01, 30.0, 0.01, 0, len(ranges), *ranges, 0]
    return " ".join(map(str, [*words, *[0.0] * 11, stamp, "robot", stamp]))


def test_a_carmen_log_is_read_by_the_2d_laser(installed: Any, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    bearing = -1.5 + 0.01 * np.arange(301)
    wall = np.where(np.abs(bearing) < 0.2, 2.0 / np.cos(bearing), 6.0)
    lines = ["# a comment", "ODOM 0 0 0 0 0 0 1.0 robot 1.0"]
    for second in range(3):
        noisy = (wall + rng.normal(0, 0.003, 301)).round(4)
        lines += [_line(f"ROBOTLASER{n}", 100.0 + second, noisy.tolist()) for n in (1, 2)]
    (tmp_path / "lab.clf").write_text("\n".join(lines))
    registry = rigcal.Registry.from_entry_points()
    board = {"type": "checkerboard", "columns": 6, "rows": 5, "square_size_m": 0.1}
    board |= {"width_m": 0.85, "height_m": 0.8}
    laser = {"type": "lrf2d", "topic": "ROBOTLASER1", "sigma_m": 0.003}
    content = {"version": 1, "root": "a", "targets": {"board": board}, "sensors": {"a": laser}}
    rig = rigcal.parse_rig(content, registry)
    seen = rigcal.detect(rig, registry, tmp_path / "lab.clf", jobs=1)
    assert [o.stamp_ns for o in seen] == [100 * 10**9, 101 * 10**9, 102 * 10**9]
    assert all(o.candidates for o in seen)
    laser["topic"] = "ROBOTLASER3"
    with pytest.raises(rigcal.RigcalError, match="it has ROBOTLASER1, ROBOTLASER2"):
        rigcal.detect(rigcal.parse_rig(content, registry), registry, tmp_path / "lab.clf", jobs=1)
