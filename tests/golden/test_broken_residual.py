"""What a user reads when a plugin's residual breaks its contract in the middle of a calibration."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.observation import Candidate, Observation, PoseGeometry
from rigcal.observation_file import save_observations
from rigcal.plugin import SensorConfig, SensorType, hookimpl
from rigcal.residual import PoseResidual, residual_of_geometry

HERE = Path(__file__).parent
RIG = """\
version: 1
root: bow
targets: {board: {type: checkerboard, columns: 8, rows: 5, square_size_m: 0.1}}
sensors: {bow: {type: sonar, topic: bow}, stern: {type: sonar, topic: stern}}
"""


class SonarConfig(SensorConfig, frozen=True):
    type: Literal["sonar"] = "sonar"


class Sonar:
    def __init__(self, fault: Any) -> None:
        self.fault = fault

    @hookimpl
    def rigcal_sensor_types(self) -> list[SensorType]:
        def unused(*_: object) -> None:
            raise AssertionError("this test hands over observations")

        return [SensorType("sonar", SonarConfig, (".none",), unused, unused, self.residual)]

    def residual(self, candidate: Candidate, config: Any, target: Any) -> Any:
        good = residual_of_geometry(candidate)
        assert isinstance(good, PoseResidual)
        return self.fault(good.T_s_t, good.W) if candidate.score < 1 else good


class FiveColumns(PoseResidual):
    def __call__(self, T_s_t: Array) -> tuple[Array, Array]:
        r, J = super().__call__(T_s_t)
        return r, J[:, :5]


class NotFinite(PoseResidual):
    def __call__(self, T_s_t: Array) -> tuple[Array, Array]:
        r, J = super().__call__(T_s_t)
        return r * np.array([1, 1, np.nan, 1, 1, 1]), J


@dataclass(frozen=True, eq=False)
class SplitBlocks(PoseResidual):
    block: int = 4


@dataclass(frozen=True, eq=False)
class NoNumber(PoseResidual):
    dof: Any = "6"


def nothing(T_s_t: Array, W: Array) -> None:
    """A factory that forgets to return what it made."""


def exits(T_s_t: Array, W: Array) -> None:
    sys.exit(9)


@pytest.mark.parametrize("fault", [FiveColumns, NotFinite, SplitBlocks, NoNumber, nothing, exits])
def test_sensor_exposure_and_shapes_are_named(
    fault: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: Any,
) -> None:
    entry = SimpleNamespace(
        name="sonar",
        load=lambda: Sonar(fault),
        dist=SimpleNamespace(name="acme-sonar", version="2.0"),
    )
    monkeypatch.setattr("rigcal.plugin.registry.entry_points", lambda group: [entry])
    rng = np.random.default_rng(0)
    observations = []
    for k in range(6):
        T = se3.exp(np.concatenate([rng.normal(0, 0.4, 3), rng.normal([0, 0, 3], 0.3)]))
        for sensor in ("bow", "stern"):
            score = 0.5 if (sensor, k) == ("stern", 4) else 1.0
            candidate = Candidate(PoseGeometry(T, np.eye(6) * 1e-6), {}, score)
            observations.append(Observation(sensor, f"pose{k}", 0, "", (candidate,)))
    (tmp_path / "rig.yaml").write_text(RIG)
    save_observations(tmp_path / "seen.npz", observations)
    arguments = ("calibrate", "rig.yaml", "seen.npz", "--out", "out", "--quiet")
    monkeypatch.chdir(tmp_path)
    ran = command(*arguments)
    assert ran.code == 2
    text = ran.err.replace(f"{__name__}.", "acme_sonar.")
    path = HERE / "messages" / f"residual_{fault.__name__.lower()}.txt"
    if "RIGCAL_UPDATE_GOLDEN" in os.environ:
        path.write_text(text)
    assert text == path.read_text()
    assert not list((tmp_path / "out").glob("*.yaml"))
