"""A sonar plugin, a rig of two sonars, and the result of its calibration, told in advance."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest
import typer

from rigcal.calibration import Calibration, Rejection, ResidualStatistics, SensorResult
from rigcal.observation import Candidate, Detection, Observation, PointGeometry
from rigcal.plugin import InputError, SensorConfig, SensorType, hookimpl

RIG = """\
version: 1
root: bow
targets:
  board: {type: checkerboard, columns: 7, rows: 5, square_size_m: 0.1}
sensors:
  bow: {type: sonar, files: bow/*.csv}
  stern: {type: sonar, files: stern/*.csv}
"""


class SonarConfig(SensorConfig, frozen=True):
    type: Literal["sonar"] = "sonar"


def _decode(message: object, config: object) -> object:
    return message


def _detect(frame: object, config: object, target: object) -> Detection:
    return Detection((), "deaf")


def ping(name: str, loud: bool = False) -> None:
    """Answer."""
    typer.echo(f"pong {name}" + "!" * loud)


def fail(mendable: bool = False) -> None:
    """Fail, unexpectedly or not."""
    if mendable:
        raise InputError("no tape")
    raise ZeroDivisionError("in the plugin")


class Sonar:
    @hookimpl
    def rigcal_sensor_types(self) -> list[SensorType]:
        return [SensorType("sonar", SonarConfig, (".csv",), _decode, _detect)]

    @hookimpl
    def rigcal_commands(self) -> list[tuple[str, Callable[..., Any]]]:
        return [("ping", ping), ("fail", fail)]

    @hookimpl
    def rigcal_schemas(self) -> list[tuple[str, Callable[..., Any]]]:
        return [("notes", lambda registry: {"title": "notes"})]


def _observation(sensor: str, exposure: str) -> Observation:
    geometry = PointGeometry(np.ones(3), np.eye(3), np.zeros(3))
    if exposure == "3":
        return Observation(sensor, exposure, 0, f"{sensor}/{exposure}.csv", (), "too dark")
    return Observation(sensor, exposure, 0, f"{sensor}/{exposure}.csv", (Candidate(geometry, {}),))


OBSERVATIONS = tuple(_observation(s, e) for e in "123" for s in ("bow", "stern"))
T_BOW_STERN = np.array([[0, -1, 0, 1.5], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
CALIBRATION = Calibration(
    "bow",
    {
        "bow": SensorResult("bow", np.eye(4), None, 2, 2, ResidualStatistics("m", 0.01, 2)),
        "stern": SensorResult(
            "bow", T_BOW_STERN, np.eye(6) * 1e-6, 2, 2, ResidualStatistics("m", 0.02, 2)
        ),
    },
    rejected=(Rejection("bow", "3", "bow/3.csv", "too dark"),),
    warnings=("stern: few exposures",),
    provenance={"seed": 0},
)


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a rig and a recording, and a sonar plugin, whose estimate is CALIBRATION."""
    dist = SimpleNamespace(name="acme-sonar", version="2.0")
    entry = SimpleNamespace(name="sonar", load=Sonar, dist=dist)
    monkeypatch.setattr("rigcal.plugin.registry.entry_points", lambda group: [entry])
    for module, name, answer in (
        ("rigcal.detection", "detect", OBSERVATIONS),
        ("rigcal.estimation", "calibrate", CALIBRATION),
    ):
        monkeypatch.setattr(import_module(module), name, lambda *_, answer=answer, **__: answer)
    monkeypatch.setenv("COLUMNS", "160")
    (tmp_path / "rig.yaml").write_text(RIG)
    for name in ("bow", "stern"):
        (tmp_path / "recording" / name).mkdir(parents=True)
        (tmp_path / "recording" / name / "1.csv").write_text("1,2,3")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def calibration() -> Calibration:
    return CALIBRATION
