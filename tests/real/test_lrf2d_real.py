"""Ring 8 of a VLP-16, taken as a 2D laser, on the 40 poses of acfr_vlp16."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigcal.geometry.se3 import Array
from rigcal.observation import Candidate, Detection, LineGeometry
from rigcal.recording.cloud import read_cloud
from rigcal.recording.message import Message
from rigcal.targets.target import Target, TargetConfig
from rigcal_lrf2d import LRF2D, Lrf2dConfig

ROOT = Path(__file__).parents[2]
DATA = Path(os.environ.get("RIGCAL_DATA", ROOT.parent / "shared" / "data"))
CLOUDS = DATA / "acfr_vlp16" / "data" / "vlp" / "pcd"
CONFIG = Lrf2dConfig(filter={"ring": 8}, sigma_m=0.02)
SIZE = np.array([0.61, 0.85])


def board() -> Target:
    outline = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * SIZE / 2
    return Target("board", TargetConfig(type="plain"), outline, np.zeros((0, 3)))


def message(path: Path) -> Message:
    return Message(".pcd", path, 0, path.stem, str(path))


def hand_cut(pose: int) -> Array:
    """x and y (N, 2) of the board's points on ring 8, as the recording's authors cut them."""
    points = read_cloud(message(CLOUDS / f"pose{pose}_target.pcd"))
    on_ring = points["ring"] == 8
    xy: Array = np.column_stack([points["x"], points["y"]])[on_ring].astype(np.float64)
    return xy


def points_of(candidate: Candidate) -> Array:
    measured: dict[str, Any] = dict(candidate.measurement)
    u = np.column_stack([np.cos(measured["angles"]), np.sin(measured["angles"])])
    result: Array = u * measured["ranges"][:, None]
    return result


def is_board(candidate: Candidate, expected: Array) -> bool:
    """Whether nearly all of its points are the board's, and nearly all of the board's are in it."""
    distance = np.linalg.norm(points_of(candidate)[:, None] - expected, axis=-1)
    return (
        float(np.mean(distance.min(axis=1) < 1e-3)) > 0.9
        and float(np.mean(distance.min(axis=0) < 1e-3)) > 0.85
    )


@pytest.fixture(scope="module")
def detections() -> dict[int, Detection]:
    found = {}
    for pose in range(1, 41):
        scan = LRF2D.decode(message(CLOUDS / f"pose{pose}_full.pcd"), CONFIG)
        found[pose] = LRF2D.detect(scan, CONFIG, board())
    return found


def test_the_candidates_include_the_board(detections: dict[int, Detection]) -> None:
    ranks = []
    for pose, detection in detections.items():
        expected = hand_cut(pose)
        ranks += [i for i, c in enumerate(detection.candidates) if is_board(c, expected)][:1]
    assert len(ranks) >= 38
    assert np.count_nonzero(np.array(ranks) == 0) >= 20


def test_the_ends_of_the_board_are_edges(detections: dict[int, Detection]) -> None:
    edges = []
    for pose, detection in detections.items():
        expected = hand_cut(pose)
        for candidate in detection.candidates:
            geometry = candidate.geometry
            if is_board(candidate, expected) and isinstance(geometry, LineGeometry):
                edges += [geometry.start_is_edge, geometry.end_is_edge]
                length = float(np.linalg.norm(geometry.end - geometry.start))
                assert 0.2 < length < np.hypot(*SIZE) + 0.03
    assert np.mean(edges) > 0.9
