"""Poses for rig.yaml from trees of frames that know different sensors, or contradict each other."""

from __future__ import annotations

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.proposal.poses import Forest, poses_of

T_A_B = se3.exp(np.array([0.0, 0.0, 0.0, 0.3, 0.0, 0.0]))
T_LIDAR_A = se3.exp(np.array([0.0, 0.0, 0.0, 0.0, 0.5, 0.0]))


def _forest(source: str, frames: dict[str, tuple[str, Array]]) -> Forest:
    names = {*frames, *(parent for parent, _ in frames.values())}
    return Forest(source, frames, {name: name for name in sorted(names) if name != "top"})


def test_sources_without_the_root_do_not_hang_sensors_from_each_other() -> None:
    """Each takes its first sensor as reference: a in b and b in a would be a circle."""
    first = _forest("first", {"b": ("a", T_A_B)})
    second = Forest("second", {"a": ("b", se3.inverse(T_A_B))}, {"b": "b", "a": "a"})
    poses, sources = poses_of([first, second], "lidar")
    assert {name: pose["parent"] for name, pose in poses.items()} == {"b": "a"}
    assert sources == {"b": "first"}
    # With a third between them as well.
    between = Forest("between", {"c": ("b", T_A_B)}, {"b": "b", "c": "c"})
    around = Forest("around", {"a": ("c", T_A_B)}, {"c": "c", "a": "a"})
    poses, _ = poses_of([first, between, around], "lidar")
    assert {name: pose["parent"] for name, pose in poses.items()} == {"b": "a", "c": "b"}


def test_the_source_that_knows_the_root_counts_first() -> None:
    first = _forest("first", {"b": ("a", T_A_B)})
    rooted = _forest("rooted", {"a": ("lidar", T_LIDAR_A)})
    poses, sources = poses_of([first, rooted], "lidar")
    assert sources == {"a": "rooted", "b": "first"}
    assert poses["a"]["parent"] == "lidar"
    np.testing.assert_allclose(poses["a"]["translation_m"], [0, 0.5, 0])
    np.testing.assert_allclose(poses["b"]["translation_m"], [0.3, 0, 0])


def test_frames_that_hang_from_each_other_in_a_circle_give_no_pose() -> None:
    circle = _forest(
        "circle", {"lidar": ("a", T_LIDAR_A), "a": ("b", T_A_B), "b": ("lidar", T_A_B)}
    )
    assert poses_of([circle], "lidar") == ({}, {})
