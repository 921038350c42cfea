"""`rigcal compare` with the poses that a rig file states."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import rigcal
from rigcal.calibration import Calibration, SensorResult

RIG = """\
version: 1
root: lidar
targets: {{board: {{type: checkerboard, columns: 8, rows: 5, square_size_m: 0.1}}}}
sensors:
  lidar: {{type: lrf3d, topic: /points}}
  cam1:
    type: lrf3d
    topic: /points2
    pose: {{parent: lidar, translation_m: [{x}, 0.0, 0.0]}}
"""


def test_command_compares_with_the_poses_of_a_rig_file(tmp_path: Path, command: Any) -> None:
    T = np.eye(4)
    T[0, 3] = 0.5
    rigcal.save_calibration(tmp_path / "a.yaml", _calibration(T))
    rig = tmp_path / "rig.yaml"
    rig.write_text(RIG.format(x=0.5))
    assert command("compare", tmp_path / "a.yaml", rig)[0] == 0
    rig.write_text(RIG.format(x=0.6))
    code, text, _ = command("compare", tmp_path / "a.yaml", rig)
    assert (code, "Moved: cam1" in text) == (1, True)
    code, text, error = command("compare", rig, rig)
    assert (code, "0.00" in text) == (2, True)
    assert "neither has a covariance of cam1" in error
    code, _, error = command("compare", tmp_path / "a.yaml", tmp_path / "none.yaml")
    assert (code, "no such file" in error) == (2, True)


def _calibration(T_lidar_cam1: Any) -> Calibration:
    covariance = np.diag([0.001, 0.002, 0.001, 0.002, 0.001, 0.003]) ** 2
    sensors = {"cam1": SensorResult("lidar", T_lidar_cam1, covariance)}
    return Calibration("lidar", {"lidar": SensorResult("lidar", np.eye(4)), **sensors})
