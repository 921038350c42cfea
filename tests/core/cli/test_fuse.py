"""`rigcal fuse`: what it prints of a fused moment."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigcal.calibration import Calibration
from rigcal.calibration_file import save_calibration
from rigcal.fusing import Fused


def test_points_lags_and_files_are_told(
    place: Path,
    calibration: Calibration,
    monkeypatch: pytest.MonkeyPatch,
    command: Callable[..., Any],
) -> None:
    save_calibration("calibration.yaml", calibration)
    rng = np.random.default_rng(0)
    fused = Fused(
        "bow",
        rng.normal(size=(5, 3)),
        np.full((5, 3), 99, np.uint8),
        np.zeros(5, int),
        ("bow",),
        np.array([0, 0, 1, -1, -1]),
        ("left", "right"),
        lag_s={"bow": 0.0, "left": -0.0123, "right": 0.004, "mast": 0.0},
        places={"bow": np.zeros(3)},
    )
    monkeypatch.setattr("rigcal.fusing.fuse", lambda *_: fused)
    run = ("fuse", "recording", "calibration.yaml", "--rig", "rig.yaml", "--out", "f")
    assert command(*run) == (
        0,
        "5 points, 3 coloured, from bow's frame\n"
        "  left: taken 12.3 ms earlier\n"
        "  right: taken 4.0 ms later\n"
        "cloud            f/cloud.ply\n"
        "picture          f/cloud.png\n",
        "",
    )
    assert Path("f/cloud.png").read_bytes().startswith(b"\x89PNG")
