"""Every observation that the result does not rest on is named with its reason."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from rigcal.estimation import calibrate
from rigcal.geometry import se3
from rigcal.observation import Candidate, Observation, PoseGeometry
from rigcal.plugin import SensorConfig, SensorType, hookimpl
from rigcal.plugin.registry import Registry
from rigcal.rig import parse_rig

SIGMA = 0.003
T_A_B = se3.exp(np.array([0.1, -0.2, 0.4, 0.3, -0.2, 0.1]))


class PoseConfig(SensorConfig, frozen=True):
    type: Literal["pose"] = "pose"


class Plugin:
    @hookimpl
    def rigcal_sensor_types(self) -> list[SensorType]:
        def unused(*_: object) -> None:
            raise AssertionError("this test hands over observations")

        return [SensorType("pose", PoseConfig, (".none",), unused, unused)]


@pytest.mark.parametrize("seed", range(2))
def test_what_is_not_used_is_named_whichever_round_dropped_it(seed: int) -> None:
    """Exposures a little off: too good for the first gates, too bad for the chi-square test."""
    registry = Registry([Plugin()])
    board = {"type": "checkerboard", "columns": 8, "rows": 5, "square_size_m": 0.1}
    sensors = {name: {"type": "pose", "topic": name} for name in "ab"}
    rig = parse_rig(
        {"version": 1, "root": "a", "targets": {"board": board}, "sensors": sensors}, registry
    )
    rng = np.random.default_rng(seed)
    observations = []
    for k in range(20):
        turn, place = rng.normal(0, 0.4, 3), rng.normal([0, 0, 3], 0.3)
        T_a_t = se3.exp(np.concatenate([turn, place]))
        poses = {"a": T_a_t, "b": se3.inverse(T_A_B) @ T_a_t}
        for name, T in poses.items():
            noisy = T @ se3.exp(rng.normal(0, SIGMA, 6))
            candidate = Candidate(PoseGeometry(noisy, np.eye(6) * SIGMA**2), {})
            observations.append(Observation(name, str(k), 0, f"{name}{k}", (candidate,)))
    for i, sigmas in zip((1, 3, 5, 7), (6, 8, 12, 20), strict=True):
        geometry = observations[i].candidates[0].geometry
        assert isinstance(geometry, PoseGeometry)
        T_off = geometry.T_s_t @ se3.exp(np.array([0, 0, 0, sigmas * SIGMA, 0, 0]))
        off = Candidate(PoseGeometry(T_off, geometry.covariance), {})
        observations[i] = replace(observations[i], candidates=(off,))

    result = calibrate(rig, registry, observations)

    for name in rig.sensors:
        named = [r for r in result.rejected if r.sensor == name]
        assert len({r.exposure for r in named}) == len(named)
        assert all(r.reason for r in named)
        assert result.sensors[name].inliers == 20 - len(named) < 20
