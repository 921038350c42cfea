"""The three complete examples of rigcal inside another program."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import rigcal
from rigcal.geometry import se3
from rigcal.recording import Source, open_recording


def test_a_rig_from_arrays_is_found(desk: Any, page: Any) -> None:
    names = desk.follow(page("guide/embed.md")).names
    calibration, truth = names["calibration"], names["T_lidar"]
    for name in ("left", "right"):
        error = se3.log(se3.inverse(calibration.T("lidar", name)) @ truth[name])
        whitened = np.linalg.solve(np.linalg.cholesky(calibration.sensors[name].covariance), error)
        assert np.sum(whitened**2) < 27.9  # chi-square with 6 degrees of freedom, 1 in 10 000
        assert np.linalg.norm(error[3:]) < 0.01
    np.testing.assert_allclose(names["T_lidar_left"], calibration.T("lidar", "left"), atol=1e-12)
    assert "stopped while" in desk.printed
    assert names["by_hand"].candidates[0].by_hand


CAMERA = {
    "type": "camera", "width_px": 320, "height_px": 240, "focal_px": [270.0, 270.0],
    "principal_px": [159.5, 119.5],
}  # fmt: skip
SHIFT = se3.transform(np.eye(3), np.array([0.0, 0.02, 0.0]))
BOARD = {
    "type": "apriltag_grid", "columns": 4, "rows": 3, "tag_size_m": 0.12, "tag_gap_m": 0.03,
}  # fmt: skip


def _rig() -> dict[str, Any]:
    pose = {"parent": "left", "translation_m": [0.2, 0.01, 0.0], "rpy_deg": [1, -4, 2]}
    return {
        "version": 1,
        "root": "left",
        "targets": {"board": BOARD},
        "sensors": {
            "left": {**CAMERA, "topic": "/left/image_raw"},
            "right": {**CAMERA, "topic": "/right/image_raw", "pose": pose},
        },
    }


@pytest.fixture(scope="module")
def registry() -> rigcal.Registry:
    return rigcal.Registry.from_entry_points()


def _simulate(registry: rigcal.Registry, out: Path, seed: int) -> Path:
    from rigcal_sim import simulate

    rig = rigcal.parse_rig(_rig(), registry)
    return simulate(rig, registry, None, seed, out, poses=8, jobs=1).recordings[0]


@pytest.fixture(scope="module")
def accepted(registry: rigcal.Registry, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _simulate(registry, tmp_path_factory.mktemp("accepted"), 1)


class _Live:
    """A message as rclpy hands it over: bytes are an array, and there are no numpy arrays."""

    def __init__(self, message: Any) -> None:
        from array import array

        self.header = message.header
        for name in ("height", "width", "encoding", "is_bigendian", "step"):
            setattr(self, name, getattr(message, name))
        self.data = array("B", message.data.tobytes())


def test_a_node_calibrates_from_live_messages(
    desk: Any, page: Any, accepted: Path, registry: rigcal.Registry
) -> None:
    desk.write(page("guide/ros2-node.md"))
    sys.path.insert(0, str(desk.folder))
    import live_calibration  # type: ignore[import-not-found]

    rig = rigcal.parse_rig(_rig(), registry)
    assert live_calibration.ros_type(registry.sensor_type("camera")) == "sensor_msgs/msg/Image"
    live = live_calibration.LiveCalibration(rig, registry)
    assert "there is no observation of sensor" in live.on_calibrate()
    assert live.on_capture() == "exposure 0000: the board was seen by no sensor"
    with open_recording(accepted) as recording:
        streams = [recording.read(Source(topic=s.topic)) for s in rig.sensors.values()]
        for messages in zip(*streams, strict=True):
            for sensor, message in zip(rig.sensors, messages, strict=True):
                live.on_message(sensor, message.type, _Live(message.value))
            answer = live.on_capture()
    assert answer == "exposure 0008: the board was seen by left, right"
    calibration = live.on_calibrate()
    assert isinstance(calibration, rigcal.Calibration)
    truth = rigcal.load_calibration(accepted.parent / "truth.yaml")
    assert rigcal.evaluate(calibration, truth).sensors["right"].translation_m < 0.005
    ((parent, child, translation, quaternion),) = live_calibration.static_transforms(calibration)
    assert (parent, child) == ("left", "right")
    np.testing.assert_allclose(translation, [0.2, 0.01, 0.0], atol=0.005)
    T = truth.T("left", "right")
    np.testing.assert_allclose(se3.rotation_from_quaternion(quaternion), T[:3, :3], atol=0.005)


@pytest.fixture(scope="module")
def before(accepted: Path, registry: rigcal.Registry) -> rigcal.Calibration:
    rig = rigcal.parse_rig(_rig(), registry)
    return rigcal.calibrate(rig, registry, rigcal.detect(rig, registry, accepted, jobs=1))


@pytest.fixture(scope="module")
def tonight(registry: rigcal.Registry, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _simulate(registry, tmp_path_factory.mktemp("tonight"), 2)


def test_a_nightly_check_is_silent_when_nothing_moved(
    desk: Any, page: Any, before: rigcal.Calibration, tonight: Path
) -> None:
    rigcal.save_calibration(desk.folder / "accepted" / "calibration.yaml", before)
    (desk.folder / "rig.yaml").write_text(yaml.safe_dump(_rig()))
    (desk.folder / "tonight.mcap").symlink_to(tonight)
    desk.follow(page("guide/nightly-check.md"))
    assert "Moved: none" in desk.printed


def test_a_nightly_check_tells_what_moved(
    desk: Any,
    page: Any,
    before: rigcal.Calibration,
    tonight: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    right = before.sensors["right"]
    shifted = replace(right, T_parent_sensor=right.T_parent_sensor @ SHIFT)
    sensors = {**before.sensors, "right": shifted, "mast": right}
    rigcal.save_calibration(desk.folder / "accepted.yaml", replace(before, sensors=sensors))
    (desk.folder / "rig.yaml").write_text(yaml.safe_dump(_rig()))
    desk.write(page("guide/nightly-check.md"))
    with pytest.raises(SystemExit) as caught:
        desk.run(f"python nightly_check.py rig.yaml {tonight} accepted.yaml tonight.yaml")
    assert caught.value.code == 1
    moved, missing = capsys.readouterr().out.splitlines()
    assert re.match(r"right moved by (19|20|21)\.\d mm and 0\.\d+ deg, ", moved)
    assert missing == "mast is missing tonight"
    assert (desk.folder / "tonight.yaml").is_file()


def test_a_night_without_a_recording_is_no_alarm(
    desk: Any, page: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    desk.write(page("guide/nightly-check.md"))
    (desk.folder / "rig.yaml").write_text(yaml.safe_dump(_rig()))
    with pytest.raises(SystemExit) as caught:
        desk.run("python nightly_check.py rig.yaml none.mcap accepted.yaml tonight.yaml")
    assert caught.value.code == 2
    expected = "no check tonight: RecordingError: none.mcap: there is no such file"
    assert expected in capsys.readouterr().err


def test_a_night_that_fails_in_any_way_is_no_alarm(
    desk: Any, page: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rigcal, "load_rig", lambda *_: 1 / 0)
    desk.write(page("guide/nightly-check.md"))
    with pytest.raises(SystemExit) as caught:
        desk.run("python nightly_check.py rig.yaml tonight.mcap accepted.yaml tonight.yaml")
    assert caught.value.code == 2
    assert capsys.readouterr().err == "no check tonight: ZeroDivisionError: division by zero\n"
