"""A VLP-16 and a board of 610 x 850 mm: whole clouds, no hint, against boards cut out by hand.

Data: github.com/acfr/cam_lidar_calibration, data/vlp (see the folder's README).
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from rigcal.geometry.shapes import fit_plane
from rigcal.observation import Candidate, PlaneGeometry
from rigcal.recording.message import Message
from rigcal.targets.target import Target, TargetConfig
from rigcal_lrf3d import LRF3D, Lrf3dConfig

ROOT = Path(__file__).parents[2]
PCD = Path(os.environ.get("RIGCAL_DATA", ROOT.parent / "shared" / "data")) / (
    "acfr_vlp16/data/vlp/pcd"
)
CONFIG = Lrf3dConfig(files="pose*_full.pcd", sigma_m=0.015)


def _read(name: str) -> np.ndarray:
    path = PCD / name
    points: np.ndarray = LRF3D.decode(Message(".pcd", path, 0, None, name), CONFIG).points
    return points


def _is_target(candidate: Candidate, cut: np.ndarray) -> bool:
    g = candidate.geometry
    assert isinstance(g, PlaneGeometry)
    angle = np.degrees(np.arccos(min(1.0, float(g.normal @ fit_plane(cut)[0]))))
    return bool(angle < 3.0 and np.linalg.norm(g.center - cut.mean(axis=0)) < 0.1)


def test_the_board_is_found_in_whole_clouds() -> None:
    outline = np.array([[-0.305, -0.425], [0.305, -0.425], [0.305, 0.425], [-0.305, 0.425]])
    board = Target("board", TargetConfig(type="plain"), outline, np.zeros((0, 3)))
    among = first = 0
    for k in range(1, 41):
        cloud = LRF3D.decode(
            Message(".pcd", PCD / f"pose{k}_full.pcd", 0, str(k), f"pose{k}"), CONFIG
        )
        candidates = LRF3D.detect(cloud, CONFIG, board).candidates
        hits = [_is_target(c, _read(f"pose{k}_target.pcd")) for c in candidates]
        among += any(hits)
        first += hits[:1] == [True]
    assert among >= 39
    assert first >= 38
