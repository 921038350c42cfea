"""The board is carried the way people carry one."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal_sim.carry import Leg, carry, ease, tour
from rigcal_sim.poses import board_pose
from rigcal_sim.timing import ContinuousConfig

TILT = np.array([10.0, -20.0, 15.0])
POSES = np.array(
    [
        board_pose(0, 1.5, 0.0, TILT),
        board_pose(40, 2.5, 0.2, -TILT),
        board_pose(200, 2.0, -0.2, 2 * TILT),
    ]
)
CONFIG = ContinuousConfig(mode="continuous", hold_s=2.0, speed_m_s=0.5, turn_deg_s=40.0)


def motion(T: Array, dt: float) -> tuple[Array, Array]:
    """Speed (m/s) and turn rate (deg/s) between poses (N, 4, 4) that are dt apart."""
    speed = np.linalg.norm(np.diff(T[:, :3, 3], axis=0), axis=1) / dt
    R = T[:-1, :3, :3].swapaxes(1, 2) @ T[1:, :3, :3]
    return speed, np.degrees(se3.rotation_angle(R)) / dt


def test_the_board_is_still_while_it_is_held() -> None:
    carrying = carry(POSES, CONFIG, seed=1)
    for k, start in enumerate(carrying.start_s):
        T, number = carrying.at(np.linspace(start, start + 2.0, 5))
        np.testing.assert_allclose(T, np.broadcast_to(POSES[k], (5, 4, 4)), atol=1e-12)
        assert np.all(number == k)
    assert carrying.start_s[0] == 0
    assert carrying.end_s == carrying.start_s[-1] + 2.0


def test_the_way_keeps_to_the_speeds_and_has_no_jerk() -> None:
    carrying = carry(POSES, CONFIG, seed=1)
    times = np.arange(0, carrying.end_s, 0.002)
    speed, turn = motion(carrying.at(times)[0], 0.002)
    assert speed.max() < 0.5 * 1.01
    assert turn.max() < 40.0 * 1.01
    assert max(speed.max() / 0.5, turn.max() / 40.0) > 0.95
    # Neither speed nor acceleration jumps, so that hands could do it.
    assert np.abs(np.diff(speed)).max() < 0.5 * 0.002 * 10
    assert np.abs(np.diff(speed, 2)).max() < 0.5 * 0.002**2 * 100


def test_ease_is_at_rest_at_both_ends() -> None:
    s = np.linspace(-0.1, 1.1, 1201)
    way = ease(s)
    assert way[0] == 0
    assert way[-1] == 1
    assert np.all(np.diff(way) >= 0)
    assert np.abs(np.diff(way, 2)).max() < 1e-5


def test_a_short_way_is_straight() -> None:
    T = Leg(POSES[0], POSES[1]).poses(np.linspace(0, 1, 11))
    np.testing.assert_allclose(T[[0, -1]], POSES[:2], atol=1e-12)
    line = POSES[1, :3, 3] - POSES[0, :3, 3]
    off = np.cross(T[:, :3, 3] - POSES[0, :3, 3], line / np.linalg.norm(line))
    np.testing.assert_allclose(off, 0, atol=1e-12)


def test_a_long_way_goes_around_the_rig_with_the_face_towards_it() -> None:
    T = Leg(POSES[0], POSES[2]).poses(np.linspace(0, 1, 50))
    np.testing.assert_allclose(T[[0, -1]], POSES[[0, 2]], atol=1e-12)
    radius = np.linalg.norm(T[:, :2, 3], axis=1)
    assert radius.min() >= 1.5 - 1e-9
    assert radius.max() <= 2.0 + 1e-9
    facing = np.einsum("ni,ni->n", T[:, :2, 2], -T[:, :2, 3]) / radius
    assert facing.min() > 0.6


def test_tremor_has_the_amplitude_given_and_a_mean_of_zero() -> None:
    config = CONFIG.model_copy(update={"hold_s": 60.0, "tremor_mm": 2.0, "tremor_deg": 0.3})
    carrying = carry(POSES[:1], config, seed=1)
    T, _ = carrying.at(np.arange(0, 60, 0.01))
    xi = se3.log(se3.inverse(POSES[0]) @ T)
    np.testing.assert_allclose(xi[:, 3:].std(axis=0), 0.002, rtol=0.2)
    np.testing.assert_allclose(np.degrees(xi[:, :3]).std(axis=0), 0.3, rtol=0.2)
    np.testing.assert_allclose(xi.mean(axis=0), 0, atol=2e-4)
    assert not np.allclose(carry(POSES[:1], config, seed=2).at(np.array([1.0]))[0], T[100])


@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_the_tour_visits_every_pose_once_and_is_short(count: int) -> None:
    rng = np.random.default_rng(count)
    poses = np.array(
        [board_pose(rng.uniform(0, 360), rng.uniform(1, 3), 0, np.zeros(3)) for _ in range(count)]
    )

    def length(order: list[int]) -> float:
        T = poses[list(order)]
        turn = se3.rotation_angle(T[:-1, :3, :3].swapaxes(1, 2) @ T[1:, :3, :3])
        steps = np.linalg.norm(np.diff(T[:, :3, 3], axis=0), axis=1)
        return float((steps + turn).sum())

    order = tour(poses)
    assert sorted(order) == list(range(count))
    assert order[0] == 0
    best = min(length([0, *rest]) for rest in permutations(range(1, count)))
    assert length(order) <= 1.1 * best
