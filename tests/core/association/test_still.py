"""Exposures of a board that is carried from place to place and held still."""

from __future__ import annotations

import numpy as np
import pytest

from rigcal.association.still import is_held, still_intervals
from rigcal.geometry import se3
from rigcal.observation import PlaneGeometry


def found(intervals, holds):
    """Numbers of the holds that intervals lie in; every interval lies in one."""
    numbers = []
    for start, end in intervals:
        inside = [k for k, (a, b) in enumerate(holds) if start >= a - 0.15 and end <= b + 0.15]
        assert len(inside) == 1, f"{start:.2f} to {end:.2f} s is no hold"
        numbers += inside
    return numbers


def wall(w, n=8, spread=0.0):
    """Pieces of walls as a scan shows them, always in the same places."""
    places = np.random.default_rng(5).uniform([1.5, -2.0, 0.0], [4.0, 2.0, 0.0], (n, 3))
    return lambda: [w.line(p, p + np.array([0.1, 0.7, 0.0])) for p in places]


def test_a_camera_alone_finds_every_hold(world):
    w = world(8)
    intervals = still_intervals([w.stream("cam", lambda T: [w.pose(T)])], 1.0)
    assert found(intervals, w.holds) == list(range(8))


def test_hands_that_tremble_hold_still(world):
    w = world(8, tremor_m=0.001)
    intervals = still_intervals([w.stream("cam", lambda T: [w.pose(T)])], 1.0)
    assert found(intervals, w.holds) == list(range(8))


def test_sensors_at_their_own_rates_agree_on_when(world):
    w = world(10)
    streams = [
        w.stream("cam", lambda T: [w.pose(T)], 3.0),
        w.stream("other", lambda T: [w.pose(T)], 2.7, 0.1),
        w.stream("lidar", lambda T: [w.plane(T)], 1.0, 0.3),
        w.stream("scan", lambda T: [w.cut(T)], 3.3, 0.05),
    ]
    intervals = still_intervals(streams, 1.0)
    assert found(intervals, w.holds) == list(range(10))
    assert min(end - start for start, end in intervals) > 0.8


def test_lasers_find_the_holds_without_a_camera_among_walls(world):
    w = world(8)
    pieces = wall(w)
    streams = [
        w.stream("lidar", lambda T: [w.plane(T)], 3.0, 0.3),
        w.stream("scan", lambda T: [*pieces(), w.cut(T)], 3.3, 0.05),
    ]
    assert found(still_intervals(streams, 1.0), w.holds) == list(range(8))


def test_a_sensor_that_sees_the_board_in_part_of_a_hold_does_not_break_it(world):
    w = world(8)
    flicker = np.random.default_rng(3)
    streams = [
        w.stream("cam", lambda T: [w.pose(T)]),
        w.stream("lidar", lambda T: [w.plane(T)] if flicker.random() < 0.6 else [], 3.0, 0.2),
    ]
    assert found(still_intervals(streams, 1.0), w.holds) == list(range(8))


def test_walls_and_a_board_that_never_rests_make_no_exposures(world):
    w = world(12)
    w.holds = [(a, a) for a, _ in w.holds]
    pieces = wall(w)
    rng = np.random.default_rng(2)

    def wander(T):
        return T @ se3.exp(np.concatenate([np.zeros(3), rng.normal(0, 0.2, 3)]))

    streams = [
        w.stream("cam", lambda T: [w.pose(wander(T))]),
        w.stream("scan", lambda T: [*pieces(), w.cut(wander(T))], 3.3),
    ]
    assert still_intervals(streams, 1.0) == []


@pytest.mark.parametrize("seed", range(3))
def test_one_frame_of_each_pose_is_not_a_board_held_still(world, seed):
    w = world(30, seed)
    k = iter([*range(30)] * 2)
    w.holds = [(float(i), float(i)) for i in range(30)]
    w.end_s = 30.0
    pieces = wall(w)
    streams = [
        w.stream("cam", lambda _: [w.pose(w.T_s_t[next(k)])], 1.0),
        w.stream("scan", lambda _: [*pieces(), w.cut(w.T_s_t[next(k)])], 1.0),
    ]
    assert not is_held(still_intervals(streams, 1.0), streams)


def test_what_never_moves_is_background_and_the_board_is_not(world):
    w = world(10)
    pieces = wall(w)
    stream = w.stream("scan", lambda T: [*pieces(), w.cut(T)])
    assert stream.is_background[stream.number < 8].mean() > 0.95
    assert stream.is_background[stream.number == 8].mean() < 0.05


def test_a_cabinet_front_as_large_as_the_board_is_background_for_a_3d_laser(world):
    w = world(10)
    n = np.array([0.0, -0.6, -0.8])
    center = np.array([0.3, 0.2, 2.5])

    def front():
        return PlaneGeometry(n, -float(n @ center), center, np.diag([1e-5, 1e-5, 4e-6]))

    stream = w.stream("lidar", lambda T: [front(), w.plane(T)])
    assert stream.is_background[stream.number == 0].all()
    assert not stream.is_background[stream.number == 1].any()


def test_a_board_that_stays_where_it_is_is_no_background(world):
    w = world(1)
    w.holds, w.end_s = [(0.0, 20.0)], 20.0
    stream = w.stream("lidar", lambda T: [w.plane(T)])
    assert not stream.is_background.any()
