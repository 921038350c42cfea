"""What a sensor saw in each exposure: one candidate of several frames, or why there is none."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rigcal.association.continuous import Exposure
from rigcal.association.gathering import IN_MOTION, UNSTEADY, still_observations
from rigcal.association.rest import BACKGROUND
from rigcal.exposures import FrameStamp
from rigcal.frames import DetectedFrame, Stream
from rigcal.observation import Candidate, Detection

START_NS = 1_600_000_000_000_000_000
PLAIN = SimpleNamespace(combine=None, residual=None)


def observed(w, see, times, kind=PLAIN):
    """Observations of a sensor in the holds of a world; `see(k, t)` gives geometries in hold k, or
    the reason for none; k is None in between."""

    def ns(time_s):
        return START_NS + round(time_s * 1e9)

    def hold(t):
        return next((k for k, (start, end) in enumerate(w.holds) if start <= t <= end), None)

    frames = []
    for i, t in enumerate(times):
        found = see(hold(t), t)
        if isinstance(found, str):
            detection = Detection((), found)
        else:
            detection = Detection(tuple(Candidate(g, {"frame": np.array(i)}) for g in found))
        frames.append(DetectedFrame(FrameStamp("scan", ns(t), None, i), f"#{i}", detection))
    stamps = np.array([f.stamp.stamp_ns for f in frames])
    stream = Stream(Path(), (), "scan", None, kind, w.target, stamps)
    exposures = [
        Exposure(f"{k:04d}", ns(start), ns(end), frozenset(["scan"]))
        for k, (start, end) in enumerate(w.holds)
    ]
    return still_observations(exposures, {"scan": stream}, frames)


def test_frames_of_a_hold_are_one_candidate_and_the_others_say_that_the_board_moves(world):
    w = world(3)
    found = observed(w, lambda k, t: [w.pose(w.at(t))], w.times(5.0))
    *held, moving = found
    for o, T in zip(held, w.T_s_t, strict=True):
        (candidate,) = o.candidates
        assert len(o.frames) == 10
        np.testing.assert_allclose(candidate.geometry.T_s_t, T, atol=2e-3)
        assert candidate.geometry.covariance[3, 3] < 0.5e-6
    assert (moving.candidates, moving.reason) == ((), IN_MOTION)
    assert len(moving.frames) > 10


def test_a_hold_during_which_a_sensor_is_silent_is_none_of_its_exposures(world):
    w = world(3)
    first, _, last = (np.arange(start, end, 0.2) for start, end in w.holds)
    found = observed(w, lambda k, t: [w.pose(w.at(t))], [*first, *last])
    assert [o.exposure for o in found] == ["0000", "0002"]
    assert all(o.candidates for o in found)


def test_a_detector_that_flickers_sees_the_board_and_one_that_sees_nothing_says_why(world):
    w = world(2)
    count = iter(range(1000))
    reasons = ["too dark", "too dark", "no corners"]

    def see(k, t):
        n = next(count)
        return [w.pose(w.at(t))] if k == 0 and n % 2 else reasons[n % 3]

    flickering, blind, _ = observed(w, see, w.times(5.0))
    assert len(flickering.candidates) == 1
    assert (blind.candidates, blind.reason) == ((), "too dark")


def test_a_board_that_is_nowhere_twice_is_no_candidate(world):
    w = world(2)
    far = iter(np.linspace(0, 3, 1000))

    def see(k, t):
        T = w.at(t)
        T[0, 3] += 20 * next(far) if k == 1 else 0
        return [w.plane(T)]

    steady, unsteady, _ = observed(w, see, w.times(5.0))
    assert len(steady.candidates) == 1
    assert (unsteady.candidates, unsteady.reason) == ((), UNSTEADY)


def test_a_wall_behind_a_board_that_is_not_seen_is_named_background(world):
    w = world(8)
    wall = np.array([3.5, -0.5, 0.0]), np.array([3.6, 0.6, 0.0])
    found = observed(
        w, lambda k, t: [w.line(*wall), *([w.cut(w.at(t))] if k != 2 else [])], w.times(5.0)
    )
    reasons = {o.exposure: o.reason for o in found if not o.candidates}
    assert reasons == {"0002": BACKGROUND, "in motion": IN_MOTION}


def test_a_plugin_that_cannot_combine_frames_loses_them_and_says_so(world):
    def combine(candidates, mean, config, target):
        raise KeyError("corners")

    w = world(1)
    kind = SimpleNamespace(combine=combine, residual=None)
    (lost,) = observed(w, lambda k, t: [w.pose(w.at(t))], w.times(5.0), kind)
    assert lost.candidates == ()
    assert lost.reason == "its frames could not be combined: KeyError: 'corners'"


@pytest.mark.parametrize("combine", [None, lambda *_: pytest.fail("nothing to combine")])
def test_the_only_frame_of_a_hold_stands_for_itself(world, combine):
    w = world(2)
    kind = SimpleNamespace(combine=combine, residual=None)
    first, second = observed(w, lambda k, t: [w.pose(w.at(t))], [0.9, 4.4], kind)
    assert first.candidates[0].measurement["frame"] == 0
    assert second.candidates[0].measurement["frame"] == 1
    assert second.candidates[0].geometry.covariance[3, 3] == pytest.approx(1e-6)
