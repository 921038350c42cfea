"""Checks of the whole estimate: a rig of this sensor and a reference that measures poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from rigcal.calibration import Calibration
from rigcal.estimation import calibrate
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.observation import Observation
from rigcal.plugin import Registry, SensorType, hookimpl
from rigcal.rig import Rig
from rigcal.testing import reference
from rigcal.testing.capability import needs
from rigcal.testing.stage import Stage
from rigcal.testing.statistics import assert_chi_square


class EstimateChecks(Stage):
    """The sensor is calibrated, and its covariance is true."""

    exposures = 16
    runs = 16

    @needs("candidates")
    def test_covariance_is_true(self) -> None:
        """The normalised estimation errors squared of `runs` rigs have a chi-square law.

        (Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001,
        5.4.2.)
        """
        total = 0.0
        for seed in range(self.runs):
            T_ref_s, observations = self._recording(seed)
            result = self._calibrated(observations).sensors["sensor"]
            assert result.covariance is not None
            e = se3.log(se3.inverse(result.T_parent_sensor) @ T_ref_s)
            total += float(e @ np.linalg.solve(result.covariance, e))
        assert_chi_square(total, 6 * self.runs, "the estimate (NEES)")

    @needs("candidates")
    def test_order_of_observations_and_candidates_does_not_matter(self) -> None:
        _, observations = self._recording(0)
        with_decoys = _with_decoys(observations)
        reordered = [replace(o, candidates=o.candidates[::-1]) for o in with_decoys[::-1]]
        first, second = (self._calibrated(seen) for seen in (with_decoys, reordered))
        T, T2 = (result.sensors["sensor"].T_parent_sensor for result in (first, second))
        np.testing.assert_allclose(se3.log(se3.inverse(T) @ T2), np.zeros(6), atol=1e-6)

    def _recording(self, seed: int) -> tuple[Array, list[Observation]]:
        """`T_ref_s` of a rig, and what both of its sensors report."""
        rng = np.random.default_rng(1000 + seed)
        T_ref_s = se3.exp(rng.normal(size=6) * [1, 1, 1, 0.3, 0.3, 0.3])
        seen = []
        for k, T_s_t in enumerate(self.poses(rng, self.exposures)):
            found = {
                "reference": reference.observe(T_ref_s @ T_s_t, None, self.target, rng),
                "sensor": self.candidate(T_s_t, rng),
            }
            seen += [Observation(n, str(k), k, f"{n} #{k}", (c,)) for n, c in found.items()]
        return T_ref_s, seen

    def _calibrated(self, observations: Sequence[Observation]) -> Calibration:
        @hookimpl
        def rigcal_sensor_types() -> list[SensorType]:
            return [self.sensor_type, reference.REFERENCE]

        types: Any = SimpleNamespace(rigcal_sensor_types=rigcal_sensor_types)
        registry = Registry([types])
        sensors = {"reference": reference.ReferenceConfig(), "sensor": self.config}
        board = self.target.config
        rig = Rig("kit", "reference", {"board": board}, sensors, noise="configured")
        return calibrate(rig, registry, observations)


def _with_decoys(observations: Sequence[Observation]) -> list[Observation]:
    """The sensor's observations, each with the candidate of another exposure as second choice."""
    others = [o.candidates[0] for o in observations if o.sensor == "sensor"]
    shifted = iter([*others[1:], others[0]])
    return [
        replace(o, candidates=(*o.candidates, replace(next(shifted), score=o.candidates[0].score)))
        if o.sensor == "sensor"
        else o
        for o in observations
    ]
