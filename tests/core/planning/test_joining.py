"""Which poses join what nothing links yet."""

import numpy as np

from rigcal.planning.candidates import BoardPose
from rigcal.planning.joining import Joining


def seen_by(*names):
    return BoardPose("board", np.eye(4), names)


def test_a_pose_must_be_shared_with_a_sensor_that_is_joined():
    joining = Joining(["a", "b"], [("x",), ("y", "z")])
    assert joining.is_wanted(seen_by("a", "x"))
    assert joining.is_wanted(seen_by("b", "z"))
    assert not joining.is_wanted(seen_by("a", "b"))
    assert not joining.is_wanted(seen_by("x", "y"))


def test_a_pair_that_has_begun_is_pursued_until_it_is_linked():
    joining = Joining(["a", "b"], [("x",)])
    joining.add(seen_by("a", "x"), ())
    assert joining.is_wanted(seen_by("a", "x"))
    assert not joining.is_wanted(seen_by("b", "x"))
    for _ in range(3):
        joining.add(seen_by("a", "b", "x"), ())
    assert joining.is_wanted(seen_by("a", "x"))
    joining.add(seen_by("a", "x"), ())
    assert not joining.is_wanted(seen_by("a", "x"))


def test_one_exposure_that_fixes_a_pose_joins_its_whole_group():
    joining = Joining(["a"], [("x", "y"), ("z",)])
    joining.add(seen_by("a", "x"), {"a", "x"})
    assert not joining.is_wanted(seen_by("a", "y"))
    assert joining.is_wanted(seen_by("y", "z"))


def test_what_is_firm_within_its_own_group_is_not_joined():
    """Two cameras fix each other; the laser that sees the board with them does not fix them."""
    joining = Joining(["laser"], [("left", "right")])
    joining.add(seen_by("laser", "left", "right"), {"left", "right"})
    assert joining.is_wanted(seen_by("laser", "left"))
