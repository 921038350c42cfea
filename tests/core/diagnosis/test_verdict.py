"""Verdicts on poses measured by ideal sensors: what is open, weak or known, and why."""

import numpy as np
import pytest

from rigcal.diagnosis.observability import judge
from rigcal.diagnosis.verdict import AXES, PLAN, Axis, SensorVerdict, Verdict
from rigcal.geometry import se3
from rigcal.graph.edge import SensorTargetEdge
from rigcal.residual import PlaneResidual, PoseResidual, whitener


def on_pose(T_s_t, rng, sigma=1e-3):
    noisy = T_s_t @ se3.exp(rng.normal(0, sigma, 6))
    return PoseResidual(noisy, whitener(np.eye(6) * sigma**2))


def on_plane(T_s_t, sigma=2e-3):
    """Distances of three points of the board's plane, without noise."""
    points = se3.apply(T_s_t, np.array([[0.4, 0, 0], [-0.4, 0.3, 0], [0, -0.4, 0]]))
    return PlaneResidual(np.column_stack([points, np.ones(3)]) / sigma)


def scene(rng, boards, kinds):
    """Edges, `T_root_s` and `T_root_t` of sensors that see all the boards."""
    sensors = {
        name: se3.exp(np.array([0, 0, 0, 0.3 * i, 0.1, 0])) if i else np.eye(4)
        for i, name in enumerate(kinds)
    }
    targets = {str(k): T for k, T in enumerate(boards)}
    edges = [
        SensorTargetEdge(s, k, on_pose(T_s_t, rng) if kind == "pose" else on_plane(T_s_t))
        for s, kind in kinds.items()
        for k, T in targets.items()
        for T_s_t in [se3.inverse(sensors[s]) @ T]
    ]
    return edges, sensors, targets


def boards_of(rng, count=12, tilt=0.6, spread=(1.0, 0.5, 1.0)):
    """Boards around 3 m along z, turned to a sensor there."""
    face = se3.exp(np.array([np.pi, 0, 0, 0, 0, 0]))[:3, :3]
    return [
        se3.transform(
            se3.exp_so3(rng.uniform(-tilt, tilt, 3)) @ face,
            np.array([0, 0, 3]) + rng.uniform(-1, 1, 3) * spread,
        )
        for _ in range(count)
    ]


def verdict_of(edges, sensors, targets, flat=()):
    root = next(iter(sensors))
    return judge(edges, sensors, targets, frozenset({root}), root, frozenset(flat))


def test_tilted_boards_determine_all_axes():
    rng = np.random.default_rng(0)
    verdict = verdict_of(*scene(rng, boards_of(rng), {"a": "pose", "b": "plane"}))
    assert verdict.summary == "The pose is determined."
    assert not verdict.withheld
    assert not verdict.weak


def test_parallel_boards_leave_what_they_cannot_say_open():
    rng = np.random.default_rng(1)
    verdict = verdict_of(*scene(rng, boards_of(rng, tilt=0.0), {"a": "pose", "b": "plane"}))
    named = verdict.sensors["b"].named("open")
    assert named == ["rotation about z", "translation along x", "translation along y"]
    assert verdict.withheld == ("b",)
    assert verdict.sensors["b"].causes == ("all boards are parallel",)


def test_noise_of_tilts_is_not_taken_for_tilts():
    """Boards that differ by the noise of their estimate only say no more than parallel ones."""
    rng = np.random.default_rng(2)
    edges, sensors, targets = scene(rng, boards_of(rng, tilt=0.0), {"a": "pose", "b": "plane"})
    noisy = {k: T @ se3.exp(rng.normal(0, 2e-3, 6)) for k, T in targets.items()}
    verdict = verdict_of(edges, sensors, noisy)
    assert len(verdict.sensors["b"].named("open")) == 3


@pytest.mark.parametrize(
    ("boards", "cause"),
    [
        ({"tilt": 0.0, "spread": (0.1, 0.1, 1.0)}, "the board is always in the same part"),
        ({"tilt": 0.0, "spread": (1.0, 1.0, 0.0)}, "all boards are parallel"),
        ({"tilt": 0.0, "spread": (0.1, 0.1, 0.05)}, "all boards stand at one distance, 3"),
    ],
)
def test_causes_are_told(boards, cause):
    rng = np.random.default_rng(3)
    verdict = verdict_of(*scene(rng, boards_of(rng, **boards), {"a": "pose", "b": "plane"}))
    assert any(text.startswith(cause) for text in verdict.sensors["b"].causes)
    assert verdict.sensors["b"].advice
    assert all(f"because {c}" in "\n".join(verdict.lines()) for c in verdict.sensors["b"].causes)


def test_few_shared_exposures_are_told_with_the_partner():
    rng = np.random.default_rng(4)
    boards = boards_of(rng, count=3, tilt=0.05)
    verdict = verdict_of(*scene(rng, boards, {"a": "pose", "b": "plane"}))
    assert "it shares 3 exposures only (3 with a)" in verdict.sensors["b"].causes
    assert "10 exposures or more that it shares with a" in verdict.sensors["b"].advice


def test_a_root_that_hangs_loosely_is_judged_from_the_others():
    rng = np.random.default_rng(5)
    kinds = {"b": "plane", "a": "pose", "c": "pose"}
    verdict = verdict_of(*scene(rng, boards_of(rng, tilt=0.0), kinds))
    assert verdict.reference in ("a", "c")
    assert verdict.withheld == ("b",)


def test_a_sensor_without_data_is_wholly_open():
    rng = np.random.default_rng(6)
    edges, sensors, targets = scene(rng, boards_of(rng), {"a": "pose", "b": "pose"})
    verdict = verdict_of(edges, {**sensors, "lost": np.eye(4)}, targets)
    assert verdict.sensors["lost"].named("open") == list(AXES)
    assert verdict.withheld == ("lost",)


def test_plain_data_of_a_verdict_name_every_axis():
    rng = np.random.default_rng(7)
    verdict = verdict_of(*scene(rng, boards_of(rng, tilt=0.0), {"a": "pose", "b": "plane"}))
    axes = verdict.as_mapping()["sensors"]["b"]["axes"]
    assert list(axes) == [f"{kind}_{a}" for kind in ("rotation", "translation") for a in "xyz"]
    assert axes["rotation_z"] == {"state": "open", "sigma": None}
    assert axes["rotation_x"]["state"] == "determined"
    assert 0 < axes["rotation_x"]["sigma"] < 1e-2


def test_weak_poses_are_told_with_their_spread_and_what_to_record():
    good, loose, tilted = Axis("determined", 1e-4), Axis("weak", 0.03), Axis("weak", 0.02)
    sound = SensorVerdict((good,) * 6)
    weak = SensorVerdict(
        (tilted, *(good,) * 4, loose), ("its boards are far away",), ("boards nearer to it",)
    )
    verdict = Verdict("root", {"cam": sound, "scan": weak})
    assert verdict.lines() == [
        "Every pose is determined, weakly that of scan.",
        "  scan, about and along the axes of its own frame, as seen from root:",
        "    weak: rotation about x (+-1.1 deg), translation along z (+-30 mm)",
        "    because its boards are far away",
        "    to record: boards nearer to it",
        PLAN,
    ]
    assert Verdict("root", {"cam": sound, "scan": sound}).lines() == ["All 2 poses are determined."]
