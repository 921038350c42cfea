"""`rigcal fuse`: the cloud of one moment, coloured by the cameras."""

import json

import cv2
import numpy as np
import pytest
from plyfile import PlyData

from rigcal import load_calibration, load_rig
from rigcal.geometry import se3
from rigcal.plugin.registry import Registry
from rigcal.rig import build_targets


@pytest.fixture(scope="module")
def exposure(calibrated):
    """An exposure in which both cameras and the 3D laser saw the board, and its number."""
    result = load_calibration(calibrated / "calibration.yaml")
    lost = {r.exposure for r in result.rejected}
    return next(name for name in sorted(result.target_poses) if name not in lost)


@pytest.fixture(scope="module")
def fused(calibrated, simulated, command, rig, exposure, tmp_path_factory):
    out = tmp_path_factory.mktemp("fused")
    options = ("--rig", rig, "--out", out, "--frame", int(exposure), "--quiet")
    recording, calibration = simulated / "recording.mcap", calibrated / "calibration.yaml"
    assert command("fuse", recording, calibration, *options).code == 0
    return out


def cloud(folder):
    data = PlyData.read(str(folder / "cloud.ply"))
    vertices = data["vertex"]
    points = np.stack([vertices[n] for n in "xyz"], axis=1).astype(float)
    colours = np.stack([vertices[n] for n in ("red", "green", "blue")], axis=1)
    return points, colours, vertices["sensor"], data.comments


def on_board(points, calibrated, exposure, rig):
    registry = Registry.from_entry_points()
    (target,) = build_targets(load_rig(rig, registry), registry).values()
    T = load_calibration(calibrated / "calibration.yaml").target_poses[exposure]
    p = se3.apply(se3.inverse(T), points)
    inside = np.all(np.abs(p[:, :2]) < target.size / 2 - 0.02, axis=1) & (np.abs(p[:, 2]) < 0.05)
    dark = np.array(
        [
            any(cv2.pointPolygonTest(s.polygon.astype(np.float32), tuple(q), False) > 0
                for s in target.patches if s.grey < 0.5)
            and not any(cv2.pointPolygonTest(s.polygon.astype(np.float32), tuple(q), False) >= 0
                for s in target.patches if s.grey >= 0.5)
            for q in p[inside, :2].tolist()
        ]
    )  # fmt: skip
    return inside, dark


def test_points_on_the_board_have_the_colours_of_its_print(fused, calibrated, exposure, rig):
    points, colours, sensor, comments = cloud(fused)
    solid = sensor == [c.split()[-1] for c in comments].index("lidar")
    inside, dark = on_board(points[solid], calibrated, exposure, rig)
    brightness = colours[solid][inside].mean(axis=1)
    assert len(dark) > 50
    assert 0.1 < dark.mean() < 0.9
    # The print's borders blur over a pixel, and so do colours at them.
    assert np.median(brightness[~dark]) > np.median(brightness[dark]) + 60
    assert np.mean((brightness > 130) == ~dark) > 0.85


def test_scans_lie_in_their_places_in_a_colour_of_their_own(fused, calibrated, exposure, rig):
    points, colours, sensor, comments = cloud(fused)
    scan = sensor == [c.split()[-1] for c in comments].index("scan")
    assert len(np.unique(colours[scan], axis=0)) == 1
    inside, _ = on_board(points[scan], calibrated, exposure, rig)
    assert inside.sum() > 10


def test_there_is_a_picture_and_an_overlay_for_each_camera(fused):
    names = {path.name for path in fused.iterdir()}
    assert names == {"cloud.ply", "cloud.png", "overlay_left.png", "overlay_right.png"}
    assert cv2.imread(str(fused / "overlay_left.png")).shape == (480, 640, 3)


def test_it_speaks_json(calibrated, simulated, command, rig, tmp_path):
    recording, calibration = simulated / "recording.mcap", calibrated / "calibration.yaml"
    ran = command("fuse", recording, calibration, "--rig", rig, "--out", tmp_path, "--json")
    assert ran.code == 0
    answer = json.loads(ran.out)
    assert answer["coloured"] <= answer["points"]
    assert set(answer["lag_s"]) == {"left", "right", "scan", "lidar"}


def test_a_frame_that_is_not_there_is_named(calibrated, simulated, command, rig, tmp_path):
    recording, calibration = simulated / "recording.mcap", calibrated / "calibration.yaml"
    options = ("--rig", rig, "--out", tmp_path, "--frame", 999)
    ran = command("fuse", recording, calibration, *options)
    assert ran.code == 2
    assert "there is no frame 999" in ran.err
