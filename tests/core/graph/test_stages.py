"""What the rig prescribes of poses, and what sensors share that determines none."""

from dataclasses import replace

import numpy as np
import pytest

from rigcal.errors import ConfigError, NotConnectedError, NotDeterminedError
from rigcal.estimation import calibrate
from rigcal.geometry import se3
from rigcal.graph.method import Method
from rigcal.graph.selection import POSE_IS_OPEN
from rigcal.plugin import PoseConfig

KINDS = {"a": ("pose", 0.0), "b": ("pose", 30.0), "c": ("pose", -30.0)}
OFF = se3.exp(np.array([0, 0.8, 0, 0.5, 0, 0]))


def given(ring, **poses):
    """The ring with poses in the rig: name=(parent, T_parent_sensor, "fixed" or "initial")."""
    sensors = dict(ring.rig.sensors)
    for name, (parent, T, how) in poses.items():
        q = dict(zip("xyzw", se3.quaternion_from_rotation(T[:3, :3]).tolist(), strict=True))
        pose = PoseConfig(parent=parent, translation_m=tuple(T[:3, 3].tolist()), rotation=q)
        said = {"fixed": True} if how == "fixed" else {"initial": "pose"}
        sensors[name] = sensors[name].model_copy(update={"pose": pose, **said})
    return replace(ring, rig=replace(ring.rig, sensors=sensors))


def calibrated(ring, method=None):
    return calibrate(ring.rig, ring.registry, ring.observations, method=method)


def blinded(ring, sensors, exposures):
    """The ring in which some sensors see nothing in some exposures."""
    return replace(
        ring,
        observations=tuple(
            replace(o, candidates=()) if o.sensor in sensors and int(o.exposure) in exposures else o
            for o in ring.observations
        ),
    )


def test_a_pose_given_in_a_sensor_that_is_not_known_is_refused(make_ring):
    ring = given(make_ring(0, KINDS, count=4), b=("c", np.eye(4), "fixed"))
    with pytest.raises(ConfigError, match=r"sensors\.b: `fixed` and `initial` need a parent whose"):
        calibrated(ring)


def test_a_sensor_cannot_be_fixed_to_one_that_is_estimated(make_ring):
    ring = make_ring(0, KINDS, count=4)
    ring = given(ring, b=("c", np.eye(4), "fixed"), c=("a", ring.T_root["c"], "initial"))
    with pytest.raises(ConfigError, match=r"sensors\.b: fixed to 'c', which is estimated itself"):
        calibrated(ring)


def test_poses_may_be_fixed_in_a_chain(make_ring):
    ring = make_ring(0, KINDS, count=20)
    T_b_c = se3.inverse(ring.T_root["b"]) @ ring.T_root["c"]
    ring = given(ring, c=("b", T_b_c, "fixed"), b=("a", ring.T_root["b"], "fixed"))
    np.testing.assert_allclose(calibrated(ring).T("a", "c"), ring.T_root["c"], atol=1e-12)


@pytest.mark.parametrize("names", ["ab", "abc"])
def test_a_first_pose_that_is_far_off_is_told_and_not_returned(make_ring, names):
    ring = make_ring(0, {name: KINDS[name] for name in names}, count=30)
    last = names[-1]
    ring = given(ring, **{last: ("a", ring.T_root[last] @ OFF, "initial")})
    with pytest.raises(NotDeterminedError) as caught:
        calibrated(ring)
    assert f"sensor '{last}': none of its observations agrees with the other" in str(caught.value)
    assert " mm" in str(caught.value)


def test_a_fixed_pose_that_the_other_sensors_contradict_is_a_warning(make_ring):
    ring = make_ring(0, KINDS, count=30)
    found = calibrated(given(ring, c=("a", ring.T_root["c"] @ OFF, "fixed")))
    (warning,) = [w for w in found.warnings if "fixed" in w]
    assert warning.startswith("c: at its fixed pose none of its 7 observations agrees")
    right = calibrated(given(ring, c=("a", ring.T_root["c"], "fixed")))
    assert not right.warnings


@pytest.mark.parametrize("formulation", ["joint", "msgcal"])
def test_a_rig_whose_poses_are_all_given_needs_no_pair(make_ring, formulation):
    """Two exposures are too few for a pair of a plane and a pose: the boards are found."""
    ring = make_ring(1, {"a": ("plane", 0.0), "b": ("pose", 0.0)}, count=60)
    ring = given(ring, b=("a", ring.T_root["b"], "fixed"))
    both = [o.exposure for o in ring.observations if o.sensor == "b" and o.candidates]
    few = replace(ring, observations=[o for o in ring.observations if o.exposure in both[:2]])
    found = calibrated(few)
    assert len(found.target_poses) == 2
    assert found.graph_error is None
    many = calibrated(ring, Method(formulation))
    assert len(many.target_poses) == len(both)
    assert many.graph_error.edges > 0
    np.testing.assert_array_equal(many.joint_covariance.matrix, np.zeros((0, 0)))


def test_two_scans_alone_give_no_pose(make_ring):
    ring = make_ring(0, {"a": ("line", 0.0), "b": ("line", 10.0)})
    with pytest.raises(NotConnectedError, match="lines of one board do not determine a transform"):
        calibrated(ring)


@pytest.mark.parametrize("method", [Method(), Method("msgcal"), Method("msgcal", filtered=False)])
@pytest.mark.parametrize("kinds", [("pose", "point", "point"), ("plane", "line", "line")])
def test_exposures_that_leave_the_board_open_are_left_out_with_the_reason(make_ring, kinds, method):
    """Points or lines alone do not place it, though points of two sensors make an edge."""
    ring = make_ring(3, {name: (kind, 0.0) for name, kind in zip("abc", kinds, strict=True)})
    both = [o.exposure for o in ring.observations if o.sensor == "c" and o.candidates]
    ring = blinded(ring, {"a"}, {int(k) for k in both[:2]})
    found = calibrated(ring, method)
    reasons = {(r.sensor, r.exposure): r.reason for r in found.rejected}
    no_edge = method.formulation == "msgcal" and "line" in kinds
    expected = "no pair of sensors counts it among its inliers" if no_edge else POSE_IS_OPEN
    assert {reasons[s, k] for s in "bc" for k in both[:2]} == {expected}
    assert not set(both[:2]) & set(found.target_poses)
