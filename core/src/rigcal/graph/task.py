"""A rig with its observations, and everything its sensors' plugins brought."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rigcal.errors import ObservationError
from rigcal.observation import Candidate, Observation
from rigcal.plugin.contract import Residual, SensorType
from rigcal.residual import residual_of
from rigcal.rig import Rig
from rigcal.targets.target import Target

Exposures = Mapping[str, Mapping[str, Observation]]
"""Observations by exposure and sensor."""


@dataclass(frozen=True, eq=False)
class Task:
    """What is to be calibrated: `kinds` and `targets` are those that the rig names."""

    rig: Rig
    kinds: Mapping[str, SensorType]
    targets: Mapping[str, Target]
    exposures: Exposures

    def target(self, sensor: str) -> Target:
        """The target that a sensor looks at."""
        return self.targets[self.rig.target_of(sensor)]

    def residual(self, sensor: str, candidate: Candidate) -> Residual:
        """The sensor type's own residual, or the default one of the geometry."""
        config, target = self.rig.sensors[sensor], self.target(sensor)
        try:
            return residual_of(self.kinds[sensor], candidate, config, target)
        except ObservationError as error:
            exposure = self._exposure_of(sensor, candidate)
            raise ObservationError(f"sensor '{sensor}', exposure '{exposure}': {error}") from error

    def _exposure_of(self, sensor: str, candidate: Candidate) -> str:
        seen = {k: o[sensor].candidates for k, o in self.exposures.items() if sensor in o}
        return next(k for k, own in seen.items() if any(c is candidate for c in own))
