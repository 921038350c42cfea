"""From observations to a calibration, on geometry alone: what every new sensor type gets."""

import re
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from rigcal.calibration_file import load_calibration, save_calibration
from rigcal.errors import (
    NotConnectedError,
    NotDeterminedError,
    ObservationError,
    TargetSizeError,
)
from rigcal.estimation import calibrate
from rigcal.geometry import se3
from rigcal.geometry.shapes import plane_of_target
from rigcal.observation import (
    Candidate,
    LineGeometry,
    Observation,
    PlaneGeometry,
    PointGeometry,
    PoseGeometry,
)
from rigcal.plugin import PoseConfig, SensorConfig, SensorType, hookimpl
from rigcal.plugin.registry import Registry
from rigcal.rig import parse_rig

OUTLINE = np.array([[-0.5, -0.4], [0.5, -0.4], [0.5, 0.4], [-0.5, 0.4]])


class GeometricConfig(SensorConfig, frozen=True):
    type: Literal["geometric"] = "geometric"
    kind: Literal["pose", "plane", "line", "point"] = "pose"


def _unused(*_):
    raise AssertionError("this test hands over observations")


@pytest.fixture(scope="module")
def registry():
    class Plugin:
        @hookimpl
        def rigcal_sensor_types(self):
            return [SensorType("geometric", GeometricConfig, (".none",), _unused, _unused)]

    return Registry([Plugin()])


def rig_of(registry, **kinds):
    return parse_rig(
        {
            "version": 1,
            "root": next(iter(kinds)),
            "targets": {
                "board": {
                    "type": "checkerboard",
                    "columns": 8,
                    "rows": 5,
                    "square_size_m": 0.1,
                    "width_m": 1.0,
                    "height_m": 0.8,
                }
            },
            "sensors": {n: {"type": "geometric", "kind": k, "topic": n} for n, k in kinds.items()},
        },
        registry,
    )


def boards(rng, count, tilt=0.6):
    """Boards in front of the root's x axis, facing it."""
    facing = np.stack([[0, 1, 0], [0, 0, 1], [-1, 0, 0]], axis=1).astype(float)
    facing[:, 0] = np.cross(facing[:, 1], facing[:, 2])
    for _ in range(count):
        R = se3.exp_so3(rng.uniform(-tilt, tilt, 3)) @ facing
        yield se3.transform(
            R, np.array([rng.uniform(2, 4), rng.uniform(-1, 1), rng.uniform(-0.3, 0.3)])
        )


def observe(kind, T_s_t, rng, sigma=0.003):
    """A candidate with noise of its stated covariance; None where the sensor misses the board."""
    n, d = plane_of_target(T_s_t)
    if kind == "pose":
        cov = np.diag([sigma**2] * 6)
        return Candidate(PoseGeometry(T_s_t @ se3.exp(rng.normal(0, sigma, 6)), cov), {})
    if kind == "point":
        p_t = np.array([0.2, 0.1, 0.0])
        p = se3.apply(T_s_t, p_t) + rng.normal(0, sigma, 3)
        return Candidate(PointGeometry(p, np.eye(3) * sigma**2, p_t), {})
    if kind == "plane":
        m = se3.exp_so3(np.cross(n, rng.normal(0, sigma, 3))) @ n
        center = T_s_t[:3, 3] + n * rng.normal(0, sigma)
        cov = np.eye(3) * sigma**2
        return Candidate(PlaneGeometry(m, float(-m @ center), center, cov), {})
    T_t_s = se3.inverse(T_s_t)
    # The chord of the board in the plane z = 0 of the sensor.
    a = np.linspace(-np.pi, np.pi, 20000)
    rho = np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)
    with np.errstate(divide="ignore"):
        t = -d / (rho @ n)
    p_t = se3.apply(T_t_s, t[:, None] * rho)
    hit = (t > 0) & (np.abs(p_t[:, 0]) < 0.5) & (np.abs(p_t[:, 1]) < 0.4)
    if hit.sum() < 20:
        return None
    ends = (t[:, None] * rho)[hit][[0, -1]]
    across = np.array([-n[0], -n[1], 0]) / np.hypot(*n[:2])
    ends = ends + across * rng.normal(0, sigma, (2, 1))
    return Candidate(LineGeometry(ends[0], ends[1], np.eye(6) * sigma**2), {})


T_ROOT = {
    0: np.eye(4),
    1: se3.transform(
        se3.rotation_from_rpy(np.array([0.06, -0.05, 0.5])), np.array([0.1, 0.5, 0.1])
    ),
    2: se3.transform(
        se3.rotation_from_rpy(np.array([-0.05, 0.03, -0.4])), np.array([-0.2, -0.3, -0.1])
    ),
}


def record(rig, rng, count=40, tilt=0.6, outliers=0.0):
    observations = []
    for k, T_root_t in enumerate(boards(rng, count, tilt)):
        for i, (name, config) in enumerate(rig.sensors.items()):
            T_s_t = se3.inverse(T_ROOT[i]) @ T_root_t
            wrong = rng.uniform() < outliers
            if wrong:
                T_s_t = T_s_t @ se3.exp(rng.normal(0, 0.4, 6))
            candidate = observe(config.kind, T_s_t, rng)
            candidates = () if candidate is None else (candidate,)
            observations.append(
                Observation(name, str(k), 0, f"{name}{k}", candidates, "not in view")
            )
    return observations


@pytest.mark.parametrize(
    "kinds",
    [
        {"a": "pose", "b": "pose", "c": "pose"},
        {"a": "pose", "b": "plane", "c": "line"},
        {"a": "line", "b": "plane", "c": "pose"},
        {"a": "plane", "b": "line", "c": "plane"},
        {"a": "pose", "b": "point", "c": "point"},
        {"a": "plane", "b": "point", "c": "plane"},
        {"a": "plane", "b": "point"},
    ],
)
def test_finds_every_sensor_among_outliers_without_a_guess(registry, kinds):
    rig = rig_of(registry, **kinds)
    rng = np.random.default_rng(5)
    result = calibrate(rig, registry, record(rig, rng, outliers=0.15))
    for i, name in enumerate(rig.sensors):
        E = se3.inverse(T_ROOT[i]) @ result.sensors[name].T_parent_sensor
        assert np.linalg.norm(E[:3, 3]) < 0.01, name
        assert se3.rotation_angle(E[:3, :3]) < 0.01, name
        assert result.sensors[name].inliers >= 15


def test_outliers_are_rejected_with_their_reason(registry):
    rig = rig_of(registry, a="pose", b="pose")
    observations = record(rig, np.random.default_rng(1), count=12)
    for o in [o for o in observations if o.sensor == "b"][:3]:
        g = o.candidates[0].geometry
        moved = PoseGeometry(g.T_s_t @ se3.exp(np.array([0, 0.4, 0, 0.3, 0, 0])), g.covariance)
        i = observations.index(o)
        observations[i] = Observation("b", o.exposure, 0, o.origin, (Candidate(moved, {}),))
    result = calibrate(rig, registry, observations)
    wrong = {r.exposure for r in result.rejected}
    assert wrong == {"0", "1", "2"}
    assert all("mm" in r.reason for r in result.rejected)


@pytest.mark.parametrize(
    "kinds", [{"a": "pose", "b": "plane", "c": "line"}, {"a": "plane", "b": "point", "c": "plane"}]
)
def test_covariance_is_consistent_with_the_scatter(registry, kinds):
    rig = rig_of(registry, **kinds)
    nees = {"b": [], "c": []}
    for seed in range(16):
        result = calibrate(rig, registry, record(rig, np.random.default_rng(seed), count=20))
        for i, name in ((1, "b"), (2, "c")):
            s = result.sensors[name]
            e = se3.log(se3.inverse(s.T_parent_sensor) @ T_ROOT[i])
            nees[name].append(e @ np.linalg.solve(s.covariance, e))
    for values in nees.values():
        assert 4.0 < np.mean(values) < 8.5


def test_same_seed_same_result(registry):
    rig = rig_of(registry, a="pose", b="plane", c="line")
    observations = record(rig, np.random.default_rng(2), outliers=0.1)
    first, second = (calibrate(rig, registry, observations, seed=7) for _ in range(2))
    for name in rig.sensors:
        a, b = first.sensors[name], second.sensors[name]
        assert a.T_parent_sensor.tobytes() == b.T_parent_sensor.tobytes()


def test_a_rig_whose_poses_are_all_given_has_boards_and_no_covariance(registry, tmp_path):
    rig = rig_of(registry, a="pose", b="pose")
    xyz, quaternion = T_ROOT[1][:3, 3], se3.quaternion_from_rotation(T_ROOT[1][:3, :3])
    rotation = dict(zip("xyzw", quaternion.tolist(), strict=True))
    pose = PoseConfig(parent="a", translation_m=tuple(xyz), rotation=rotation)
    given = rig.sensors["b"].model_copy(update={"pose": pose, "fixed": True})
    rig = replace(rig, sensors={**rig.sensors, "b": given})
    calibration = calibrate(rig, registry, record(rig, np.random.default_rng(0)))
    assert len(calibration.target_poses) == 40
    assert calibration.sensors["b"].covariance is None
    assert calibration.verdict.summary == "No pose was estimated: all are given."
    save_calibration(tmp_path / "a.yaml", calibration)
    read = load_calibration(tmp_path / "a.yaml")
    np.testing.assert_allclose(read.T("a", "b"), calibration.T("a", "b"), atol=1e-12)


def test_sensors_that_share_nothing_are_named(registry):
    rig = rig_of(registry, a="pose", b="pose", c="pose")
    observations = [
        o
        for o in record(rig, np.random.default_rng(3), count=10)
        if (o.sensor == "c") == (int(o.exposure) >= 5)
    ]
    with pytest.raises(NotConnectedError, match=r"\{a, b\}; \{c\}") as error:
        calibrate(rig, registry, observations)
    assert "a - c: no shared exposure" in str(error.value)


def test_parallel_boards_give_no_pose(registry):
    rig = rig_of(registry, a="plane", b="plane")
    observations = record(rig, np.random.default_rng(4), tilt=0.0)
    with pytest.raises((NotConnectedError, NotDeterminedError), match=r"parallel|open"):
        calibrate(rig, registry, observations)


def test_a_sensor_that_saw_nothing_is_named(registry):
    rig = rig_of(registry, a="pose", b="pose")
    observations = [
        o if o.sensor == "a" else Observation("b", o.exposure, 0, o.origin, (), "no tag found")
        for o in record(rig, np.random.default_rng(0), count=5)
    ]
    with pytest.raises(ObservationError, match=r"'b' did not see the target.*no tag found"):
        calibrate(rig, registry, observations)


def test_a_sensor_without_observations_is_not_said_to_be_blind(registry):
    rig = rig_of(registry, a="pose", b="pose")
    seen = [o for o in record(rig, np.random.default_rng(0), count=5) if o.sensor == "a"]
    with pytest.raises(ObservationError, match="there is no observation of sensor 'b'"):
        calibrate(rig, registry, seen)


def test_of_two_observations_of_one_exposure_none_is_dropped_in_silence(registry):
    rig = rig_of(registry, a="pose", b="pose")
    seen = record(rig, np.random.default_rng(0), count=12)
    again = replace(seen[3], origin="elsewhere")
    message = f"'{again.sensor}', exposure '{again.exposure}': two observations, of .* and elsewhe"
    with pytest.raises(ObservationError, match=message):
        calibrate(rig, registry, [*seen, again])
    blank = replace(again, candidates=(), reason="not seen")
    with pytest.raises(ObservationError, match="two observations"):
        calibrate(rig, registry, [*seen, blank])


def test_observations_may_come_from_a_generator(registry):
    rig = rig_of(registry, a="pose", b="pose")
    seen = record(rig, np.random.default_rng(0), count=12)
    found = calibrate(rig, registry, (o for o in seen))
    np.testing.assert_array_equal(found.T("a", "b"), calibrate(rig, registry, seen).T("a", "b"))


def test_a_target_of_half_its_size_is_told_from_other_mistakes(registry):
    rig = rig_of(registry, a="pose", b="plane")
    observations = []
    for o in record(rig, np.random.default_rng(6)):
        g = o.candidates[0].geometry
        if isinstance(g, PoseGeometry):
            T = g.T_s_t.copy()
            T[:3, 3] /= 2
            o = Observation("a", o.exposure, 0, "", (Candidate(PoseGeometry(T, g.covariance), {}),))
        observations.append(o)
    with pytest.raises(TargetSizeError, match=r"it were [\d.]+ times as large") as caught:
        calibrate(rig, registry, observations)
    scale = re.search(r"it were ([\d.]+) times", str(caught.value))[1]
    assert float(scale) == pytest.approx(2, abs=0.02)


def test_observations_of_different_boards_give_no_pose(registry):
    rig = rig_of(registry, a="pose", b="plane")
    first = record(rig, np.random.default_rng(7))
    second = record(rig, np.random.default_rng(8))
    mixed = [o for o in first if o.sensor == "a"] + [o for o in second if o.sensor == "b"]
    with pytest.raises(NotConnectedError, match="a - b: 40 shared exposures"):
        calibrate(rig, registry, mixed)
