"""Other people's recordings, end to end from raw files, against other people's estimates.

Each estimate is somebody's, not a metrology truth: agreement bounds gross errors.
"""

import csv
import os
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigcal import Registry, calibrate, detect, load_rig
from rigcal.errors import NotDeterminedError
from rigcal.geometry import se3

ROOT = Path(__file__).parents[2]
RIGS = ROOT / "examples" / "real"
DATA = Path(os.environ.get("RIGCAL_DATA", ROOT.parent / "shared" / "data"))


@pytest.fixture(scope="session")
def registry():
    return Registry.from_entry_points()


def apart(T, expected):
    """Rotation (deg) and translation (m, per axis) between two poses."""
    angle = np.degrees(se3.rotation_angle(T[:3, :3].T @ expected[:3, :3]))
    return float(angle), np.abs(T[:3, 3] - expected[:3, 3])


@pytest.fixture(scope="session")
def acfr(registry):
    """Observations of all three sensors, and a way to calibrate some of them."""
    observations = detect(
        load_rig(RIGS / "acfr_three.yaml", registry), registry, DATA / "acfr_vlp16"
    )

    def solve(name):
        rig = load_rig(RIGS / name, registry)
        return calibrate(rig, registry, [o for o in observations if o.sensor in rig.sensors])

    return solve


@pytest.fixture(scope="session")
def camera_and_lidar(acfr):
    return acfr("acfr_vlp16.yaml")


def test_fisheye_and_vlp16_lie_inside_the_published_spread(camera_and_lidar):
    with (DATA / "acfr_vlp16/data/vlp/calibration_quickstart.csv").open() as file:
        rows = [[float(row[k]) for k in row] for row in csv.DictReader(file)]
    median = np.median(rows, axis=0)
    T_lidar_cam = se3.transform(se3.rotation_from_rpy(median[:3]), median[3:])
    angle, offset = apart(camera_and_lidar.T("lidar", "cam"), T_lidar_cam)
    assert angle < 1.0
    assert (offset < 0.03).all(), offset


def test_most_exposures_are_used_and_the_others_are_named(camera_and_lidar):
    for name in ("cam", "lidar"):
        sensor = camera_and_lidar.sensors[name]
        left_out = [r for r in camera_and_lidar.rejected if r.sensor == name]
        assert sensor.inliers >= 30
        assert sensor.inliers + len(left_out) == 40
        assert all(r.reason and r.origin for r in left_out)


def test_a_single_ring_as_a_2d_laser_agrees_with_the_3d_answer(acfr, camera_and_lidar):
    T_cam_scan = acfr("acfr_ring8.yaml").T("cam", "scan")
    # The scan has the 3D laser's frame.
    angle, offset = apart(T_cam_scan, camera_and_lidar.T("cam", "lidar"))
    assert angle < 2.0
    assert np.linalg.norm(offset) < 0.04


def test_three_sensors_in_one_graph(acfr, camera_and_lidar):
    calibration = acfr("acfr_three.yaml")
    angle, offset = apart(calibration.T("lidar", "cam"), camera_and_lidar.T("lidar", "cam"))
    assert angle < 1.0
    assert np.linalg.norm(offset) < 0.03
    angle, offset = apart(calibration.T("lidar", "scan"), np.eye(4))
    assert angle < 2.0
    assert np.linalg.norm(offset) < 0.04


def test_stereo_pair_with_a_checkerboard(registry):
    rig = load_rig(RIGS / "opencv_stereo.yaml", registry)
    calibration = calibrate(rig, registry, detect(rig, registry, DATA / "opencv_stereo_chess"))
    baseline = np.linalg.norm(calibration.T("left", "right")[:3, 3])
    assert baseline == pytest.approx(0.0832, abs=0.001)
    assert calibration.sensors["right"].residual.rms < 0.3
    # Both lenses start as the recording's own; the right one, less k3, is refined with the poses.
    left, right = (rig.sensors[name] for name in ("left", "right"))
    assert (left.focal_px, left.distortion[:4]) == (right.focal_px, right.distortion)
    found = calibration.sensors["right"].refined
    assert found["fx"].start == left.focal_px[0]
    assert found["fx"].sigma < 1.0
    assert not calibration.sensors["left"].refined


def test_a_lens_that_the_recording_leaves_open_is_named(registry):
    rig = load_rig(RIGS / "opencv_stereo.yaml", registry)
    cameras = {n: c.model_copy(update={"refine": ("lens",)}) for n, c in rig.sensors.items()}
    observations = detect(rig, registry, DATA / "opencv_stereo_chess")
    with pytest.raises(NotDeterminedError, match=r"left: lens: leaves .*least known: k3"):
        calibrate(replace(rig, sensors=cameras), registry, observations)


def test_four_partly_overlapping_webcams(registry, tmp_path):
    session = DATA / "caliscope_4cam_charuco/post_optimization"
    script = RIGS / "extract_video_frames.py"
    videos = session / "calibration" / "extrinsic"
    subprocess.run([sys.executable, script, videos, tmp_path / "frames"], check=True)
    rig = load_rig(RIGS / "caliscope.yaml", registry)
    calibration = calibrate(rig, registry, detect(rig, registry, tmp_path / "frames"))
    cameras = tomllib.loads((session / "camera_array.toml").read_text())["cameras"]
    # x_cam = R x_world + t; aligned on camera 0.
    T_cam_world = {
        f"cam{i}": se3.transform(np.array(c["rotation"]), np.array(c["translation"]))
        for i, c in cameras.items()
    }
    for name in ("cam1", "cam2", "cam3"):
        expected = T_cam_world["cam0"] @ se3.inverse(T_cam_world[name])
        angle, offset = apart(calibration.T("cam0", name), expected)
        assert angle < 1.0, name
        assert np.linalg.norm(offset) < 0.015, name


def test_a_board_of_half_its_size_is_refused(registry):
    rig = load_rig(RIGS / "acfr_vlp16.yaml", registry)
    target = rig.targets["board"].model_copy(update={"square_size_m": 0.0475})
    rig = replace(rig, targets={"board": target})
    with pytest.raises(Exception, match="times as large") as error:
        calibrate(rig, registry, detect(rig, registry, DATA / "acfr_vlp16"))
    assert error.value.exit_code == 2
