"""The graph of MSG-Cal: it finds the sensors, and its error compares solutions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigcal.calibration import Calibration, SensorResult
from rigcal.errors import ConfigError, NotConvergedError, NotDeterminedError
from rigcal.estimation import calibrate, finish, pairwise_calibration, prepare
from rigcal.evaluation import evaluate
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph import msgcal
from rigcal.graph.exposure_graph import EdgeRows
from rigcal.graph.method import Method
from rigcal.graph.msgcal import graph_error_m2


def _prepare(ring):
    return prepare(ring.rig, ring.registry, ring.observations)


def _truth(ring) -> Calibration:
    return Calibration(
        ring.rig.root, {s: SensorResult(ring.rig.root, T) for s, T in ring.T_root.items()}
    )


def _poses(calibration: Calibration) -> dict[str, Array]:
    return {s: calibration.T(calibration.root, s) for s in calibration.sensors}


@pytest.mark.parametrize(
    ("kinds", "limit"),
    [
        (None, 0.012),
        ({"a": ("pose", 0.0), "b": ("pose", 30.0), "c": ("point", 10.0)}, 0.012),
        ({"a": ("plane", 20.0), "b": ("line", 0.0), "c": ("plane", 0.0)}, 0.012),
        # Ten lines leave the height of the others known to 12 mm; a wrong one among them costs 70.
        ({"a": ("line", 0.0), "b": ("plane", 0.0), "c": ("plane", 20.0)}, 0.025),
    ],
)
@pytest.mark.parametrize("formulation", ["msgcal", "joint"])
def test_every_geometry_finds_its_place(make_ring, kinds, limit, formulation) -> None:
    ring = make_ring(3, kinds, outliers=0.1)
    stages = _prepare(ring)
    result = finish(stages, Method(formulation))
    evaluation = evaluate(result, _truth(ring))
    assert max(e.translation_m for e in evaluation.sensors.values()) < limit
    assert max(e.rotation_rad for e in evaluation.sensors.values()) < limit
    assert all(0 < s.inliers <= s.observations for s in result.sensors.values())
    assert result.provenance["formulation"] == formulation
    assert result.graph_error.edges > 40
    if formulation == "msgcal":
        assert result.graph_error.solution_m2 < result.graph_error.pairwise_m2


def test_jacobians_of_the_edges_are_their_derivatives(make_ring) -> None:
    kinds = {"a": ("pose", 0.0), "b": ("plane", 5.0), "c": ("line", 0.0), "d": ("point", 0.0)}
    graph = _prepare(make_ring(1, kinds)).graph()
    x = max(graph.exposures, key=lambda x: len(x.nodes))
    assert len(x.nodes) == 4
    rows, rng = EdgeRows.of(x), np.random.default_rng(0)
    T = se3.exp(rng.normal(0, 0.5, (2 * len(x.nodes), 6)))
    _, J = rows.evaluate(T)
    for i in range(len(T)):
        for axis in range(6):
            step = np.zeros((len(T), 6))
            step[i, axis] = 1e-6
            ahead, behind = (rows.evaluate(T @ se3.exp(s * step))[0] for s in (1, -1))
            np.testing.assert_allclose(J[:, i, axis], (ahead - behind) / 2e-6, atol=1e-7)


def test_graph_error_vanishes_without_noise_and_grows_with_a_sensors_error(make_ring) -> None:
    ring = make_ring(2, sigma=0.0)
    graph = _prepare(ring).graph()
    assert graph_error_m2(graph, ring.T_root) < 1e-20
    errors = [
        graph_error_m2(graph, ring.T_root | {"cam1": ring.T_root["cam1"] @ T})
        for T in se3.exp(np.array([[0, 0, 0, 0, 0, 0.01], [0, 0, 0, 0, 0, 0.02]]))
    ]
    # Twice the offset, four times the squares.
    assert errors[0] > 1e-5
    assert errors[1] == pytest.approx(4 * errors[0], rel=0.02)


def test_graph_error_of_two_poses_is_half_their_disagreement_at_each_node(make_ring) -> None:
    """Corners 2 cm apart along z: both nodes give way, 0.02^2 = sum of three equal parts."""
    ring = make_ring(0, {"a": ("pose", 0.0), "b": ("pose", 0.0)}, sigma=0.0)
    stages = _prepare(ring)
    graph = stages.graph()
    T = {"a": np.eye(4), "b": ring.T_root["b"] @ se3.exp(np.array([0, 0, 0, 0, 0, 0.02]))}
    # Minimum of x^2 + y^2 + (0.02 - x - y)^2 at x = y = 0.02 / 3, for four corners.
    expected = 4 * 0.02**2 / 3 * len(graph.exposures)
    assert graph_error_m2(graph, T) == pytest.approx(expected, rel=1e-3)


def test_tree_joint_and_msgcal_compare_on_one_graph(make_ring) -> None:
    errors = {"pairwise": [], "msgcal": [], "joint": []}
    means = {name: [] for name in errors}
    for seed in range(3):
        ring = make_ring(seed)
        stages = _prepare(ring)
        graph = stages.graph()
        results = {name: finish(stages, Method(name)) for name in ("msgcal", "joint")}
        results["pairwise"] = pairwise_calibration(stages)
        for name, result in results.items():
            errors[name].append(graph_error_m2(graph, _poses(result)))
            means[name].append(evaluate(result, _truth(ring)).mean_translation_m)
    assert np.all(np.array(errors["msgcal"]) < errors["pairwise"])
    assert np.all(np.array(errors["msgcal"]) <= errors["joint"])
    assert np.mean(means["joint"]) < np.mean(means["msgcal"]) < np.mean(means["pairwise"])


@pytest.mark.parametrize(("formulation", "seed"), [("msgcal", 4), ("joint", 4), ("joint", 5)])
def test_identity_start_ends_where_the_tree_does_or_says_so(make_ring, formulation, seed) -> None:
    stages = _prepare(make_ring(seed))
    reference = finish(stages, Method(formulation))
    try:
        result = finish(stages, Method(formulation, initial="identity"))
    except NotConvergedError:
        # The measurements alone may lead astray from so far off; edges in metres do not.
        result = None if formulation == "joint" else pytest.fail("msgcal did not converge")
    for s in result.sensors if result else ():
        D = se3.inverse(result.T("lidar", s)) @ reference.T("lidar", s)
        assert np.linalg.norm(se3.log(D)) < 0.002


def _turned(ring, angle):
    """First poses of all sensors but the root that are turned by an angle, rad."""
    turn = se3.exp(np.array([0.0, angle, 0.0, 0.0, 0.0, 0.0]))
    root = ring.rig.root
    return {s: T if s == root else T @ turn for s, T in ring.T_root.items()}


def test_boards_that_come_to_lie_upside_down_start_again(make_ring) -> None:
    """Where no pair is solved, as in a rig of given poses, the boards alone bring sensors near."""
    ring = make_ring(1)
    graph = replace(_prepare(ring).graph(), pairs=())
    near, far = (
        msgcal.solve(graph, _turned(ring, angle), frozenset({ring.rig.root}))
        for angle in (0.0, 2.0)
    )
    for s, T in near.sensors.items():
        np.testing.assert_allclose(far.sensors[s], T, atol=1e-4)
    # It tells how far the edges are from zero.
    np.testing.assert_allclose(
        np.diagonal(far.information.covariance), np.diagonal(near.information.covariance), rtol=1e-2
    )


def test_a_minimum_that_is_not_reached_is_an_error(make_ring, monkeypatch) -> None:
    ring = make_ring(0)
    graph = replace(_prepare(ring).graph(), pairs=())
    monkeypatch.setattr(msgcal, "_MOST_ITERATIONS", 3)
    with pytest.raises(NotConvergedError, match=r"did not converge \(error .* after 3 iterations"):
        msgcal.solve(graph, _turned(ring, 2.0), frozenset({ring.rig.root}))


@pytest.mark.parametrize("group", [{"cam2"}, {"cam2", "cam3"}])
def test_pairs_that_do_not_join_all_sensors_leave_the_others_at_their_start(
    make_ring, group
) -> None:
    """As where a given pose joins two groups; the edges of the boards do the rest."""
    kinds = {"lidar": ("plane", 0.0), "cam2": ("pose", 180.0), "cam3": ("pose", 200.0)}
    ring = make_ring(2, kinds)
    stages = _prepare(ring)
    apart = tuple(p for p in stages.pairs if (p.a in group) == (p.b in group))
    assert sum(p.T_a_b is not None for p in apart) == 1
    result = finish(replace(stages, pairs=apart), Method("msgcal", filtered=False))
    errors = evaluate(result, _truth(ring)).sensors
    assert max(error.translation_m for error in errors.values()) < 0.02


def test_a_pose_that_the_data_leave_open_is_accepted_by_the_joint_estimate_only(make_ring) -> None:
    """cam2 sees two boards together with the lidar, whose pair has no distances."""
    kinds = {"lidar": ("plane", 0.0), "cam0": ("pose", 0.0), "cam2": ("pose", 180.0)}
    ring = make_ring(3, kinds)
    seen = [o.exposure for o in ring.observations if o.sensor == "cam2" and o.candidates]
    few = tuple(
        replace(o, candidates=()) if o.sensor == "cam2" and o.exposure in seen[2:] else o
        for o in ring.observations
    )
    stages = prepare(ring.rig, ring.registry, few)
    assert stages.is_loose
    result = finish(stages, Method("joint", accept_weak=True))
    assert evaluate(result, _truth(ring)).sensors["cam0"].translation_m < 0.02
    with pytest.raises(NotDeterminedError, match="MSG-Cal leaves a pose open"):
        finish(stages, Method("msgcal", accept_weak=True))


@pytest.mark.parametrize("initial", ["tree", "identity"])
@pytest.mark.parametrize(("kinds", "edges"), [(("plane", "point"), 0), (("pose", "pose"), 3)])
def test_a_graph_whose_edges_contradict_nothing_has_no_covariance(
    make_ring, kinds, edges, initial
) -> None:
    """A plane and a point have no edge, and two poses of one board agree whatever their noise."""
    a, b = kinds
    ring = make_ring(0, {"a": (a, 0.0), "b": (b, 0.0)})
    if edges:
        unseen = {o.exposure for o in ring.observations if not o.candidates}
        one = next(o.exposure for o in ring.observations if o.exposure not in unseen)
        few = tuple(o for o in ring.observations if o.exposure == one)
        ring = replace(ring, observations=few)
    stages = _prepare(ring)
    assert stages.pairs[0].T_a_b is not None
    with pytest.raises(NotDeterminedError, match=f"MSG-Cal has {edges} edges of observations, no"):
        finish(stages, Method("msgcal", initial=initial))


def test_another_minimum_is_not_reported_as_converged(make_ring, monkeypatch) -> None:
    stages = _prepare(make_ring(8))
    mirrored = stages.T_root["cam1"] @ se3.exp(np.array([0, np.pi, 0, 0, 0, 0]))
    method = Method("msgcal", initial="identity")
    solve = msgcal.solve

    def astray(graph, sensors, fixed):
        found = solve(graph, sensors, fixed)
        first = np.array_equal(sensors["cam1"], np.eye(4))
        return replace(
            found, sensors={**found.sensors, "cam1": mirrored} if first else found.sensors
        )

    monkeypatch.setattr(msgcal, "solve", astray)
    with pytest.raises(NotConvergedError, match=r"another minimum .* off for cam1 by 180 deg"):
        finish(stages, method)


@pytest.mark.parametrize("formulation", ["msgcal", "joint"])
def test_without_the_filter_outliers_enter_and_spoil_the_result(make_ring, formulation) -> None:
    ring = make_ring(5, outliers=0.15)
    stages, truth = _prepare(ring), _truth(ring)
    with_filter, without = (finish(stages, Method(formulation, filtered=f)) for f in (True, False))
    assert all(s.inliers < s.observations for s in with_filter.sensors.values())
    for sensor in ("cam0", "cam3"):
        result = without.sensors[sensor]
        assert result.inliers == result.observations
    good, bad = (evaluate(c, truth).mean_translation_m for c in (with_filter, without))
    assert bad > 3 * good


def test_same_input_same_result_whatever_was_solved_before(make_ring) -> None:
    ring = make_ring(6)
    stages = _prepare(ring)
    finish(stages, Method("joint"))
    first = finish(stages, Method("msgcal"))
    second = calibrate(ring.rig, ring.registry, ring.observations, method=Method("msgcal"))
    for s in first.sensors:
        a, b = (c.sensors[s].T_parent_sensor for c in (first, second))
        assert a.tobytes() == b.tobytes()


def test_a_sensor_with_a_fixed_pose_keeps_it(make_ring) -> None:
    ring = make_ring(7)
    stages = _prepare(ring)
    held = replace(
        stages,
        fixed=frozenset({"lidar", "cam2"}),
        given={"lidar": np.eye(4), "cam2": ring.T_root["cam2"]},
        T_root={**stages.T_root, "cam2": ring.T_root["cam2"]},
    )
    result = finish(held, Method("msgcal"))
    np.testing.assert_array_equal(result.sensors["cam2"].T_parent_sensor, ring.T_root["cam2"])
    assert result.sensors["cam2"].covariance is None


def test_sensors_that_all_have_fixed_poses_keep_them_though_their_pair_contradicts(
    make_ring,
) -> None:
    """The graph of a plane and a point has that pair alone; its search has to end."""
    ring = make_ring(35, {"a": ("plane", 10.0), "b": ("point", 0.0)})
    graph = _prepare(ring).graph()
    assert (graph.edges, len(graph.pairs)) == (0, 1)
    poses = {"a": np.eye(4), "b": _turned(ring, 1.0)["b"]}
    found = msgcal.solve(graph, poses, frozenset(poses))
    np.testing.assert_array_equal(found.sensors["b"], poses["b"])
    assert not found.information.sensors


def test_unknown_words_are_refused() -> None:
    with pytest.raises(ConfigError, match="formulation 'joined' is unknown, expected joint or ms"):
        Method("joined")
    with pytest.raises(ConfigError, match="initial 'random' is unknown, expected tree or identity"):
        Method(initial="random")
