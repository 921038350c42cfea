"""A rig as a program describes it, and a small recording of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

import rigcal

BOARD = {
    "type": "apriltag_grid", "columns": 4, "rows": 3, "tag_size_m": 0.12, "tag_gap_m": 0.03,
}  # fmt: skip
SENSOR = {
    "type": "camera", "width_px": 320, "height_px": 240, "focal_px": [270.0, 270.0],
    "principal_px": [159.5, 119.5],
}  # fmt: skip
RIG = {
    "version": 1,
    "root": "left",
    "targets": {"board": BOARD},
    "sensors": {
        "left": {**SENSOR, "topic": "/left/image_raw"},
        "right": {
            **SENSOR,
            "topic": "/right/image_raw",
            "pose": {"parent": "left", "translation_m": [0.2, 0.01, 0.0], "rpy_deg": [1, -4, 2]},
        },
    },
}
POSES = 6


@pytest.fixture(scope="session")
def registry() -> rigcal.Registry:
    return rigcal.Registry.from_entry_points()


@pytest.fixture(scope="session")
def rig(registry: rigcal.Registry) -> rigcal.Rig:
    return rigcal.parse_rig(RIG, registry)


@pytest.fixture(scope="session")
def recording(rig: rigcal.Rig, registry: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    from rigcal_sim import simulate

    folder = tmp_path_factory.mktemp("simulated")
    return simulate(rig, registry, None, 1, folder, poses=POSES, jobs=1).recordings[0]


@pytest.fixture(scope="session")
def rig_text() -> str:
    return yaml.safe_dump(RIG)
