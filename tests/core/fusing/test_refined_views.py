"""What is fused and what reports draw has the numbers that the calibration refined."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest

from rigcal.calibration import Calibration, RefinedNumber, SensorResult
from rigcal.fusing.fuse import fuse
from rigcal.observation import Detection, Observation
from rigcal.plugin import FrameView, Registry, SensorType, hookimpl
from rigcal.ranging import RANGE_BIAS, RangeConfig
from rigcal.report.frames import show_frames
from rigcal.rig import Rig, parse_rig


class ProbeConfig(RangeConfig, frozen=True):
    type: Literal["probe"] = "probe"


def view(message: Any, config: Any) -> FrameView:
    measured = float(Path(message.value).read_text())
    return FrameView(points=np.array([[measured - config.range_bias_m, 0.0, 0.0]]))


@hookimpl
def rigcal_sensor_types() -> list[SensorType]:
    return [
        SensorType(
            "probe",
            ProbeConfig,
            (".csv",),
            lambda message, config: message,
            lambda *_: Detection((), "it detects nothing"),
            refinable={"range_bias": RANGE_BIAS},
            view=view,
        )
    ]


Case = tuple[Rig, Registry, Path, Calibration]


@pytest.fixture
def case(tmp_path: Path) -> Case:
    """A rig of one sensor that measures 2.03 m, of which 0.03 m are a bias, as was found."""
    plugin: Any = SimpleNamespace(rigcal_sensor_types=rigcal_sensor_types)
    registry = Registry([plugin])
    board = {"type": "checkerboard", "columns": 7, "rows": 5, "square_size_m": 0.1}
    probe = {"type": "probe", "files": "*.csv", "refine": ["range_bias"], "range_bias_m": 0.01}
    content = {"version": 1, "root": "probe", "targets": {"b": board}, "sensors": {"probe": probe}}
    (tmp_path / "pose1.csv").write_text("2.03")
    refined = {"range_bias_m": RefinedNumber(0.03, 0.001, 0.01, "m")}
    result = SensorResult("probe", np.eye(4), refined=refined)
    calibration = Calibration("probe", {"probe": result})
    return parse_rig(content, registry), registry, tmp_path, calibration


def test_fused_points_have_the_refined_bias(case: Case) -> None:
    rig, registry, recording, calibration = case
    np.testing.assert_allclose(fuse(rig, registry, recording, calibration).points, [[2.0, 0, 0]])


def test_frames_of_the_report_have_the_refined_bias(case: Case) -> None:
    rig, registry, recording, calibration = case
    shown: list[np.ndarray] = []
    show_frames(
        recording,
        calibration,
        rig,
        registry,
        [Observation("probe", "1", 0, "pose1.csv", (), "nothing")],
        lambda observation, seen: shown.append(np.asarray(seen.points)),
    )
    np.testing.assert_allclose(shown, [[[2.0, 0, 0]]])
