"""Simulate, calibrate, evaluate: from raw messages to a tree of transforms."""

import json
import re

import numpy as np

from rigcal import evaluate, load_calibration

SILENT = ("--quiet", "--no-report")


def test_the_truth_is_found(calibrated, simulated):
    result = load_calibration(calibrated / "calibration.yaml")
    errors = evaluate(result, load_calibration(simulated / "truth.yaml"))
    # Four times the standard deviations that 18 exposures and 16 rings allow.
    for name, limit_m, limit_deg in (
        ("left", 0.0035, 0.16),
        ("right", 0.0035, 0.16),
        ("scan", 0.013, 0.6),
    ):
        assert errors.sensors[name].translation_m < limit_m, name
        assert np.degrees(errors.sensors[name].rotation_rad) < limit_deg, name
        assert errors.sensors[name].nees < 30, name


def test_a_wrong_exposure_is_never_accepted(calibrated, simulated):
    result = load_calibration(calibrated / "calibration.yaml")
    truth = load_calibration(simulated / "truth.yaml")
    assert len(result.target_poses) >= 15
    for name, T in result.target_poses.items():
        assert np.linalg.norm(T[:3, 3] - truth.target_poses[name][:3, 3]) < 0.02, name


def test_the_bag_says_the_same_as_the_mcap(calibrated, simulated, command, rig, tmp_path):
    bag = simulated / "recording.bag"
    assert command("calibrate", rig, bag, "--out", tmp_path, *SILENT).code == 0
    first, second = (load_calibration(d / "calibration.yaml") for d in (calibrated, tmp_path))
    for name, sensor in first.sensors.items():
        np.testing.assert_array_equal(sensor.T_parent_sensor, second.sensors[name].T_parent_sensor)


def test_the_same_input_and_seed_give_the_same_bytes(calibrated, command, rig, tmp_path):
    for name in ("a", "b"):
        out, data = tmp_path / name, calibrated / "observations.npz"
        assert command("calibrate", rig, data, "--out", out, *SILENT, "--seed", 3).code == 0
    for file in ("calibration.yaml", "observations.npz"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_observations_stand_for_the_recording(calibrated, command, rig, tmp_path):
    data = calibrated / "observations.npz"
    assert command("calibrate", rig, data, "--out", tmp_path, *SILENT).code == 0
    first, second = (d / "calibration.yaml" for d in (calibrated, tmp_path))
    assert first.read_bytes() == second.read_bytes()


def test_detection_alone_does_not_depend_on_the_number_of_processes(
    calibrated, simulated, command, rig, tmp_path
):
    recording = simulated / "recording.mcap"
    out = tmp_path / "observations.npz"
    assert command("detect", rig, recording, "--out", out, "--jobs", 1, "--quiet").code == 0
    assert out.read_bytes() == (calibrated / "observations.npz").read_bytes()


def test_the_report_shows_pictures_from_the_recording(calibrated):
    page = (calibrated / "report.html").read_text()
    shown = set(re.findall(r'alt="Points of (\w+) on an image of (\w+)"', page))
    assert shown == {(laser, camera) for laser in ("lidar", "scan") for camera in ("left", "right")}
    assert set(re.findall(r'alt="Errors of (\w+):', page)) == {"left", "right", "scan", "lidar"}
    result = load_calibration(calibrated / "calibration.yaml")
    pictured = set(re.findall(r'alt="(\w+) in exposure (\w+)"', page))
    assert pictured == {(r.sensor, r.exposure) for r in result.rejected}
    assert len(page) < 5_000_000


def test_evaluate_speaks_json(calibrated, simulated, command):
    truth = simulated / "truth.yaml"
    ran = command("evaluate", calibrated / "calibration.yaml", "--truth", truth, "--json")
    assert ran.code == 0
    answer = json.loads(ran.out)
    assert set(answer["sensors"]) == {"left", "right", "scan"}
