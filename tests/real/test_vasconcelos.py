"""Planes and lines of somebody else's camera and laser, handed over through the Python API."""

import os
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from scipy.io import loadmat

from rigcal.estimation import calibrate
from rigcal.geometry import se3
from rigcal.geometry.shapes import plane_of_target
from rigcal.observation import Candidate, LineGeometry, Observation, PlaneGeometry
from rigcal.plugin import SensorConfig, SensorType, hookimpl
from rigcal.plugin.registry import Registry
from rigcal.rig import parse_rig

DATA = Path(os.environ.get("RIGCAL_DATA", Path(__file__).parents[3] / "shared" / "data"))
# The consensus fit printed in the recording's README: x_cam = R p_laser + t.
R_CONSENSUS = np.array(
    [[0.9259, -0.3757, 0.0390], [-0.1104, -0.3679, -0.9233], [0.3613, 0.8506, -0.3821]]
)
T_CONSENSUS = np.array([1.469, 0.434, 0.118])


class HandConfig(SensorConfig, frozen=True):
    type: Literal["hand"] = "hand"


class Plugin:
    @hookimpl
    def rigcal_sensor_types(self):
        return [SensorType("hand", HandConfig, (".none",), lambda *_: None, lambda *_: None)]


def plane(T_cam_board):
    n, d = plane_of_target(T_cam_board)
    n, d = (-n, -d) if d < 0 else (n, d)
    center = T_cam_board[:3, 3]
    sigma = np.array([0.003, 0.003, 0.004])
    return Candidate(PlaneGeometry(n, float(d), center, np.diag(sigma**2)), {})


def line(points, sigma=0.005):
    center = points.mean(axis=0)
    along = np.linalg.svd(points - center)[2][0]
    s = (points - center) @ along
    ends = np.zeros((2, 3))
    ends[:, :2] = center + np.outer([s.min(), s.max()], along)
    # Variance of a fitted line at its ends: about 4 / n of a point's.
    return Candidate(LineGeometry(*ends, np.eye(6) * 4 * sigma**2 / len(points)), {})


@pytest.fixture(scope="module")
def calibration():
    demo = loadmat(DATA / "vasconcelos_lrf2d" / "DemoData.mat")
    observations = []
    for k in range(12):
        T = demo["Planes"][:, :, k].copy()
        T[:3, 3] /= 1000
        points = demo["Points"].ravel()[k].T / 1000
        for sensor, candidate in (("camera", plane(T)), ("laser", line(points))):
            observations.append(Observation(sensor, str(k + 1), 0, f"plane {k + 1}", (candidate,)))
    registry = Registry([Plugin()])
    rig = parse_rig(
        {
            "version": 1,
            "root": "camera",
            "targets": {
                "board": {"type": "checkerboard", "columns": 9, "rows": 7, "square_size_m": 0.1}
            },
            "sensors": {s: {"type": "hand"} for s in ("camera", "laser")},
        },
        registry,
    )
    return calibrate(rig, registry, observations)


def test_the_gross_outliers_are_rejected_and_nothing_else(calibration):
    assert {r.exposure for r in calibration.rejected} == {"3", "5"}
    assert all("mm" in r.reason or "chi-square" in r.reason for r in calibration.rejected)


def test_the_consensus_is_found(calibration):
    T = calibration.T("camera", "laser")
    angle = np.degrees(se3.rotation_angle(T[:3, :3] @ se3.nearest_rotation(R_CONSENSUS).T))
    assert angle < 0.5
    assert np.linalg.norm(T[:3, 3] - T_CONSENSUS) < 0.010
