"""One frame of each sensor per exposure: what is in the same place in all of them is no board."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np

from rigcal.association.rest import BACKGROUND
from rigcal.association.single import single_observations
from rigcal.exposures import FrameStamp
from rigcal.frames import DetectedFrame, Stream
from rigcal.observation import Candidate, Detection

RIG = SimpleNamespace(association=None, tolerance_s=0.05)


def stream(world, sensor, see):
    """A stream and its frames of files that carry keys; `see(T_s_t)` gives geometries."""
    frames = []
    for i, T in enumerate(world.T_s_t):
        candidates = tuple(Candidate(g, {}) for g in see(T))
        stamp, detection = FrameStamp(sensor, 0, f"{i}", i), Detection(candidates, "nothing found")
        frames.append(DetectedFrame(stamp, f"{sensor}{i}.csv", detection))
    times = np.zeros(len(frames), np.int64)
    return Stream(Path(), (), sensor, None, None, world.target, times), frames


def observed(world, sensor, see):
    own, frames = stream(world, sensor, see)
    return single_observations(RIG, {sensor: own}, frames)


def test_a_wall_behind_the_board_is_no_candidate(world):
    w = world(20)
    wall = np.array([3.5, -0.5, 0.0]), np.array([3.6, 0.6, 0.0])
    found = observed(w, "scan", lambda T: [w.line(*wall), w.cut(T)])
    assert [o.exposure for o in found] == [str(i) for i in range(20)]
    for o, T in zip(found, w.T_s_t, strict=True):
        (candidate,) = o.candidates
        middle = (candidate.geometry.start + candidate.geometry.end) / 2
        assert np.hypot(middle[0] - T[2, 3], middle[1] + T[0, 3]) < 0.3


def test_where_only_the_wall_is_seen_it_is_named(world):
    w = world(20)
    wall = np.array([3.5, -0.5, 0.0]), np.array([3.6, 0.6, 0.0])
    seen = iter([True, False] * 10)
    found = observed(w, "scan", lambda T: [w.line(*wall), *([w.cut(T)] if next(seen) else [])])
    assert [len(o.candidates) for o in found] == [1, 0] * 10
    assert {o.reason for o in found if not o.candidates} == {BACKGROUND}


def test_a_board_that_was_left_standing_is_kept(world):
    """Nothing else moves: it may be the board."""
    w = world(1)
    w.T_s_t = np.repeat(w.T_s_t, 12, axis=0)
    assert all(o.candidates for o in observed(w, "lidar", lambda T: [w.plane(T)]))


def test_what_is_identified_is_the_target_wherever_it_is(world):
    w = world(1)
    w.T_s_t = np.repeat(w.T_s_t, 12, axis=0)
    assert all(o.candidates for o in observed(w, "cam", lambda T: [w.pose(T)]))


def test_two_boards_alone_are_too_few_to_tell(world):
    w = world(2)
    assert all(o.candidates for o in observed(w, "lidar", lambda T: [w.plane(T)]))
