"""Board poses as people are told them."""

import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal.planning.candidates import BoardPose
from rigcal.planning.site import Site
from rigcal.planning.words import best_view, describe
from rigcal.rig import T_root_sensors

# Of a board that faces a viewer at the root, who looks along x.
FACING = np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]])


@pytest.fixture
def site(bench):
    rig = bench.rig("gauge", "left", "slit", "back", changes={
        "left": {"pose": {"parent": "gauge", "rpy_deg": [-90.0, 0.0, -90.0]}},
    })  # fmt: skip
    return Site.of(rig, bench.registry, T_root_sensors(rig), ())


def turned(axis, degrees):
    """About an axis of the board: x right, y up, z towards the viewer."""
    return FACING @ se3.exp_so3(np.radians(degrees) * np.eye(3)["xyz".index(axis)])


def pose(R, place, *seen_by):
    return BoardPose("board", se3.transform(R, np.array(place, dtype=float)), seen_by)


@pytest.mark.parametrize(
    ("R", "place", "words"),
    [
        (FACING, (2, 0, 0), "2.0 m in front of left; upright, facing it"),
        (turned("y", -30), (2, 0, 0), "2.0 m in front of left; turned 30 degrees to the left"),
        (turned("y", 20), (2, 0, 0), "2.0 m in front of left; turned 20 degrees to the right"),
        (turned("x", -20), (3, 0, 0), "3.0 m in front of left; leaning back 20 degrees"),
        (turned("x", 15), (3, 0, 0), "3.0 m in front of left; leaning forward 15 degrees"),
        (turned("z", 45), (2, 0, 0), "2.0 m in front of left; rolled 45 degrees anticlockwise"),
        (turned("z", -10), (2, 0, 0), "2.0 m in front of left; rolled 10 degrees clockwise"),
    ],
)
def test_where_and_how_the_board_is_held(site, R, place, words):
    assert describe(site, pose(R, place, "left")) == words


def test_places_beside_above_and_behind(site):
    """The attitude is that of a board which faces the sensor from there."""

    def place(p, *seen_by):
        return describe(site, pose(FACING, p, *seen_by)).split(";")[0]

    assert (
        place((2.04, 0.5, -0.3), "left") == "2.0 m in front of left, 0.5 m to the left, 0.3 m down"
    )
    assert place((0.5, 2, 0), "gauge") == "2.0 m to the left of gauge, 0.5 m forward"
    assert place((-0.5, -2, 0.2), "gauge") == "2.0 m to the right of gauge, 0.5 m back, 0.2 m up"
    assert place((-2, 0, 0.02), "gauge") == "2.0 m behind gauge"
    assert place((0.2, 0, 2), "gauge") == "2.0 m above gauge, 0.2 m forward"
    assert place((0.44, 0.07, 0), "left") == "0.45 m in front of left, 0.05 m to the left"
    assert place((-2.3, 0, 0.1), "gauge", "back") == "2.0 m in front of back"


def test_several_tilts_are_told_together(site):
    R = FACING @ se3.exp_so3(np.radians([0.0, -30.0, 0.0]))
    R = R @ se3.exp_so3(np.radians([-20.0, 0.0, 0.0])) @ se3.exp_so3(np.radians([0.0, 0.0, 15.0]))
    assert describe(site, pose(R, (2, 0, 0), "left")).split("; ")[1] == (
        "turned 30 degrees to the left, leaning back 20 degrees, rolled 15 degrees anticlockwise"
    )


def test_a_flat_sensor_speaks_only_where_no_other_sees(site):
    ahead = (2, 0, -0.2)
    assert best_view(site, pose(FACING, ahead, "slit", "gauge")) == "gauge"
    assert best_view(site, pose(FACING, ahead, "slit")) == "slit"
    assert best_view(site, pose(FACING, (-2, 0, 0), "gauge", "back")) == "back"
