"""Sensors that measure many points of the board: which of them count, and numbers beside poses."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Literal

import numpy as np
import pytest

from rigcal.errors import NotDeterminedError
from rigcal.estimation import calibrate, prepare, solved
from rigcal.geometry import se3
from rigcal.graph import joint
from rigcal.graph.method import Method
from rigcal.observation import Candidate, Observation, PoseGeometry
from rigcal.plugin import Registry, SensorConfig, SensorType, hookimpl
from rigcal.ranging import RANGE_BIAS, RangeConfig
from rigcal.residual import PointResidual
from rigcal.rig import parse_rig

SIGMA, SCALE = 0.002, 1.005
P_T = np.array([[x, y, 0.0] for x in (-0.4, 0.0, 0.4) for y in (-0.3, 0.0, 0.3)])
T_A_B = se3.exp(np.array([0.1, -0.2, 0.4, 0.3, -0.2, 0.1]))
BOARD = {"type": "checkerboard", "columns": 9, "rows": 7, "square_size_m": 0.1}


class ProbeConfig(SensorConfig, frozen=True):
    type: Literal["probe"] = "probe"


class EyeConfig(SensorConfig, frozen=True):
    type: Literal["eye"] = "eye"


class GaugeConfig(RangeConfig, frozen=True):
    type: Literal["gauge"] = "gauge"


@dataclass(frozen=True, eq=False)
class Probed:
    """Nine points of the board, each a block of its own."""

    p_s: np.ndarray
    block: int = 3
    dof: int = 27

    def __call__(self, T_s_t):
        parts = [PointResidual(a, b, np.eye(3) / SIGMA) for a, b in zip(P_T, self.p_s, strict=True)]
        return PointResidual.stack(parts)(np.tile(T_s_t, (9, 1, 1)))


def errors(candidate, config, target, T_s_t):
    return np.linalg.norm(se3.apply(T_s_t, P_T) - candidate.measurement["p_s"], axis=1)


def _type(name, config, **more):
    def unused(*_):
        raise AssertionError("these tests hand over observations")

    return SensorType(name, config, (".none",), unused, unused, **more)


@hookimpl
def rigcal_sensor_types():
    def residual(candidate, config, target):
        return Probed(candidate.measurement["p_s"])

    return [
        _type("probe", ProbeConfig, residual=residual, errors=errors, unit="mm"),
        _type("eye", EyeConfig, angular=True),
        _type("gauge", GaugeConfig, refinable={"range_bias": RANGE_BIAS}),
    ]


REGISTRY = Registry([SimpleNamespace(rigcal_sensor_types=rigcal_sensor_types)])


def rig_of(a, b, **board):
    sensors = {"a": {"topic": "a", **a}, "b": {"topic": "b", **b}}
    content = {"version": 1, "root": "a", "targets": {"board": BOARD | board}, "sensors": sensors}
    return parse_rig(content, REGISTRY)


def boards(rng, count):
    turn, place = rng.normal(0, 0.4, (count, 3)), rng.normal([0, 0, 3], 0.4, (count, 3))
    return [{"a": T, "b": se3.inverse(T_A_B) @ T} for T in se3.exp(np.hstack([turn, place]))]


def probes(rng, count=20):
    """What two probes touch, and where they suppose the board to be."""
    found = []
    for k, poses in enumerate(boards(rng, count)):
        for name, T in poses.items():
            p_s = se3.apply(T, P_T) + rng.normal(0, SIGMA, P_T.shape)
            geometry = PoseGeometry.of(T @ se3.exp(rng.normal(0, SIGMA, 6)), SIGMA, SIGMA)
            candidate = Candidate(geometry, {"p_s": p_s})
            found.append(Observation(name, str(k), 0, f"{name}{k}", (candidate,)))
    return found


def missed(o, points, by_m=0.3):
    """The observation, some points of which are not the board's."""
    candidate = o.candidates[0]
    p_s = candidate.measurement["p_s"].copy()
    p_s[points] += by_m * np.array([[1.0, -1.0, 0.5]]) * np.arange(1, len(p_s[points]) + 1)[:, None]
    return replace(o, candidates=(replace(candidate, measurement={"p_s": p_s}),))


PROBES = rig_of({"type": "probe"}, {"type": "probe"})


def test_single_points_that_are_off_do_not_count():
    observations = probes(np.random.default_rng(0))
    for k, points in ((3, [2]), (8, [0, 7])):
        observations[2 * k + 1] = missed(observations[2 * k + 1], points)
    result = calibrate(PROBES, REGISTRY, observations)
    residual = result.sensors["b"].residual
    assert (residual.unit, residual.count) == ("mm", 9 * 20 - 3)
    assert residual.rms < 2 * SIGMA
    assert result.sensors["a"].residual.count == 9 * 20
    assert not result.rejected
    assert np.linalg.norm(se3.log(se3.inverse(T_A_B) @ result.T("a", "b"))) < SIGMA


def test_an_observation_of_which_most_points_are_off_is_left_out():
    observations = probes(np.random.default_rng(0))
    observations[25] = missed(observations[25], [0, 2, 4, 5, 6])
    result = calibrate(PROBES, REGISTRY, observations)
    assert {(r.sensor, r.exposure): r.reason for r in result.rejected} == {
        ("b", "12"): "56 % of its measurements are outliers",
        ("a", "12"): "no other sensor's data is left in this exposure",
    }


def poses_seen(rng, count=20, scale=SCALE, names=("a", "b")):
    """Poses by hand; to a, which sees directions only, a larger board is a nearer one."""
    found = []
    for k, poses in enumerate(boards(rng, count)):
        for name in names:
            T = poses[name] @ se3.exp(rng.normal(0, SIGMA, 6) / 10)
            T[:3, 3] /= scale if name == "a" else 1.0
            found.append(Observation.of(name, str(k), PoseGeometry.of(T, SIGMA / 10, SIGMA / 10)))
    return found


def test_a_number_that_is_held_stays_where_another_recording_has_it():
    rig = rig_of({"type": "eye"}, {"type": "gauge"}, refine=["scale"])
    true, other = (
        prepare(rig, REGISTRY, poses_seen(np.random.default_rng(1), scale=scale))
        for scale in (SCALE, 1.0)
    )
    found = solved(true, Method())[0].solution.numbers
    np.testing.assert_allclose(found.values, [SCALE], atol=3e-4)
    elsewhere = solved(other, Method())[0].solution
    args = (elsewhere.edges, elsewhere.sensors, elsewhere.targets, other.fixed)
    free, held = (joint.solve(*args, numbers).numbers.values for numbers in (found, found.held()))
    np.testing.assert_allclose(free, [1.0], atol=3e-4)
    np.testing.assert_allclose(held, found.values, atol=1e-8)


def test_poses_by_hand_do_not_tell_the_bias_of_ranges():
    rig = rig_of({"type": "gauge", "refine": ["range_bias"]}, {"type": "gauge"})
    observations = poses_seen(np.random.default_rng(2), scale=1.0)
    with pytest.raises(NotDeterminedError, match=r"a: range_bias: leaves far more than .*\(open\)"):
        calibrate(rig, REGISTRY, observations)
