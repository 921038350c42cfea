"""Where the observations of a run come from."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from rigcal.calibration import Calibration, SensorResult
from rigcal.detection import detect
from rigcal.observation import Observation
from rigcal.plugin import Registry
from rigcal.rig import Rig, T_root_sensors
from rigcal_sim.dataset import simulate
from rigcal_sim.features import observe_boards
from rigcal_sim.scenario import ScenarioConfig

# Runs over one recording differ in the exposures that they use.
_SUBSET = 2 / 3


class Source(Protocol):
    """Observations of a rig, drawn anew for every seed."""

    @property
    def name(self) -> str:
        """One word for tables."""

    @property
    def truth(self) -> Calibration | None:
        """Where the sensors are, if that is known."""

    def draw(self, rig: Rig, registry: Registry, seed: int) -> Sequence[Observation]:
        """The observations of one run."""


@dataclass(frozen=True, eq=False)
class Features:
    """What flawless detectors report, with the configured noise."""

    scenario: ScenarioConfig
    truth: Calibration | None
    name: str = "features"

    def draw(self, rig: Rig, registry: Registry, seed: int) -> Sequence[Observation]:
        """Boards and noise are drawn anew."""
        return observe_boards(rig, registry, self.scenario, seed).observations


@dataclass(frozen=True, eq=False)
class Raw:
    """Images, scans and clouds, simulated and put through the detectors."""

    scenario: ScenarioConfig
    truth: Calibration | None
    name: str = "raw"

    def draw(self, rig: Rig, registry: Registry, seed: int) -> Sequence[Observation]:
        """Boards and noise are drawn anew; the recording is thrown away."""
        with tempfile.TemporaryDirectory() as folder:
            summary = simulate(rig, registry, self.scenario, seed, Path(folder), jobs=1)
            return detect(rig, registry, summary.recordings[0], jobs=1)


@dataclass(frozen=True, eq=False)
class Recorded:
    """Observations of a recording, of which every run uses two thirds of the exposures."""

    observations: tuple[Observation, ...]
    truth: Calibration | None = None
    name: str = "recording"

    def draw(self, rig: Rig, registry: Registry, seed: int) -> Sequence[Observation]:
        """The exposures are drawn anew."""
        exposures = sorted({o.exposure for o in self.observations})
        count = round(_SUBSET * len(exposures))
        order = np.random.default_rng(seed).permutation(len(exposures))
        chosen = {exposures[i] for i in order[:count]}
        return [o for o in self.observations if o.exposure in chosen]


def truth_of(rig: Rig) -> Calibration:
    """The poses in the rig file, which a simulation takes for true."""
    sensors = {s: SensorResult(rig.root, T) for s, T in T_root_sensors(rig).items()}
    return Calibration(rig.root, sensors)
