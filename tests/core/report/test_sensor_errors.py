"""The errors behind the figures: of the solution as it is, with all that it refined."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest

from rigcal.calibration import Calibration, RefinedNumber, SensorResult
from rigcal.geometry import se3
from rigcal.observation import Candidate, Detection, Observation, PoseGeometry
from rigcal.plugin import SensorConfig, SensorType, hookimpl
from rigcal.plugin.registry import Registry
from rigcal.report.error_figures import error_figure
from rigcal.report.sensor_errors import SensorErrors, errors_by_sensor
from rigcal.rig import parse_rig


class EyeConfig(SensorConfig, frozen=True):
    """Measures directions only: how far the board is follows from how large it is."""

    type: Literal["eye"] = "eye"


class RulerConfig(SensorConfig, frozen=True):
    """Measures lengths."""

    type: Literal["ruler"] = "ruler"


class Sensors:
    @hookimpl
    def rigcal_sensor_types(self) -> list[SensorType]:
        def unused(*_: object) -> Detection:
            raise AssertionError("these tests hand over observations")

        made = (".csv",), unused, unused
        return [
            SensorType("eye", EyeConfig, *made, angular=True),
            SensorType("ruler", RulerConfig, *made),
        ]


def test_a_print_that_is_larger_than_stated_looks_nearer_to_a_camera_alone() -> None:
    registry = Registry([Sensors()])
    board = {"type": "checkerboard", "columns": 7, "rows": 5, "square_size_m": 0.1}
    sensors = {name: {"type": name, "files": f"{name}*.csv"} for name in ("eye", "ruler")}
    content = {"version": 1, "root": "eye", "targets": {"board": board}, "sensors": sensors}
    rig = parse_rig(content, registry)
    T, scale = se3.transform(np.eye(3), np.array([0.1, -0.2, 2.0])), 1.02
    seen = T.copy()
    seen[:3, 3] /= scale
    observations = [
        Observation(name, "1", 0, "", (Candidate(PoseGeometry(pose, np.eye(6)), {}),))
        for name, pose in (("eye", seen), ("ruler", T))
    ]
    placed = {name: SensorResult("eye", np.eye(4)) for name in sensors}
    refined = {"board": {"scale": RefinedNumber(scale, 1e-4, 1.0)}}
    result = Calibration("eye", placed, {"1": T}, refined_targets=refined)
    found = errors_by_sensor(result, observations, rig, registry)
    assert found["eye"].errors == pytest.approx(0, abs=1e-12)
    assert found["ruler"].errors == pytest.approx(0, abs=1e-12)
    plain = errors_by_sensor(replace(result, refined_targets={}), observations, rig, registry)
    assert plain["eye"].errors.item() > 0.01


@pytest.mark.parametrize("columns", [1, 2])
def test_errors_at_one_range_are_drawn_without_a_curve_over_it(columns: int) -> None:
    """A curve over the range needs ranges that differ; nothing is warned of."""
    rng = np.random.default_rng(0)
    points = np.tile([2.0, 0.0, 0.0], (30, 1))
    data = SensorErrors(
        "m", rng.normal(0, 0.01, (30, columns)), np.zeros(30, int), ("1",), np.eye(4)[None],
        points, rng.normal(size=30),
    )  # fmt: skip
    kind: Any = Registry([Sensors()]).sensor_type("ruler")
    uri = error_figure(data, kind, RulerConfig(), np.zeros(1))
    assert uri.startswith("data:image/png;base64,iVBOR")
