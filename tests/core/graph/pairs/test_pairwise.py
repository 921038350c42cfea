"""Pairs of sensors: the right transform with a true covariance, or the reason why there is none."""

from dataclasses import replace

import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal.graph import refinement
from rigcal.graph.correspondence import correspondences
from rigcal.graph.pairwise import calibrate_pair
from rigcal.graph.refinement import inliers
from rigcal.observation import PointGeometry
from rigcal.testing.features import facing_boards, observe

KINDS = [
    ("pose", "pose"),
    ("pose", "plane"),
    ("plane", "plane"),
    ("pose", "line"),
    ("plane", "line"),
    ("pose", "point"),
    ("point", "point"),
    ("plane", "point"),
]


@pytest.fixture(scope="module")
def calibrated(target):
    def calibrated(pairs, seed=0):
        return calibrate_pair(pairs, target, np.random.default_rng(seed), ("a", "b"))

    return calibrated


def off(result, T_a_b):
    """Error (6,) of a result, right perturbation."""
    assert result.T_a_b is not None, result.reason
    return se3.log(se3.inverse(result.T_a_b) @ T_a_b)


@pytest.mark.parametrize("kinds", KINDS)
def test_the_covariance_is_that_of_the_scatter(kinds, watch, calibrated, T_a_b):
    nees = []
    for seed in range(10):
        result = calibrated(watch(kinds, np.random.default_rng(seed), 30))
        e = off(result, T_a_b)
        nees.append(e @ np.linalg.solve(result.covariance, e))
    # chi2(60) / 10, 99.9 % on either side.
    assert 3.17 < np.mean(nees) < 9.96


@pytest.mark.parametrize("kinds", [KINDS[0], KINDS[1], KINDS[4]])
def test_a_disagreement_beyond_the_noise_widens_the_covariance(kinds, watch, calibrated, T_a_b):
    nees, errors = [], []
    for seed in range(8):
        result = calibrated(watch(kinds, np.random.default_rng(seed), 40, disagreement=0.008))
        e = off(result, T_a_b)
        nees.append(e @ np.linalg.solve(result.covariance, e))
        errors.append(result.model_error_m)
    assert np.median(nees) < 9.0
    assert 0.004 < np.mean(errors) < 0.013


def test_inliers_that_come_and_go_without_end_are_given_up_on(
    watch, calibrated, T_a_b, monkeypatch
):
    """One exposure at the gate: in with it out, out with it in."""
    asked = []

    def restless(c, T, model_error):
        asked.append(None)
        return inliers(c, T, model_error)[len(asked) % 2 :]

    monkeypatch.setattr(refinement, "inliers", restless)
    result = calibrated(watch(("pose", "plane"), np.random.default_rng(0)))
    e = off(result, T_a_b)
    assert e @ np.linalg.solve(result.covariance, e) < 22.5
    assert len(result.inliers) > 36


@pytest.mark.parametrize("kinds", KINDS[:-1])
def test_gross_outliers_of_both_sensors_change_nothing(kinds, watch, calibrated, T_a_b):
    for seed in range(2):
        pairs = watch(kinds, np.random.default_rng(seed), 70, outliers=0.4)
        result = calibrated(pairs, seed)
        e = off(result, T_a_b)
        assert np.linalg.norm(e[:3]) < 0.02
        assert np.linalg.norm(e[3:]) < 0.05
        assert e @ np.linalg.solve(result.covariance, e) < 40


@pytest.mark.parametrize("kinds", KINDS)
def test_sensors_that_watch_different_boards_get_no_transform(kinds, watch, calibrated):
    for seed in range(2):
        a = watch(kinds, np.random.default_rng(seed), 40)
        b = watch(kinds, np.random.default_rng(seed + 100), 40)
        result = calibrated([(x[0], y[1]) for x, y in zip(a, b, strict=False)])
        assert result.T_a_b is None
        assert "agree on a transform" in result.reason or "no transform explains" in result.reason


def test_rival_candidates_are_never_inliers_together(watch, calibrated, target, T_a_b):
    """The right candidate comes last, behind a copy that is a little off and a gross mistake."""
    pairs = watch(("pose", "plane"), np.random.default_rng(0), 30)
    rng = np.random.default_rng(1)
    rivals = []
    for a, b in pairs:
        T_b_t = se3.inverse(T_a_b) @ a.candidates[0].geometry.T_s_t
        near = observe("plane", T_b_t @ se3.exp(np.full(6, 0.02)), target, rng)
        wrong = observe("plane", T_b_t @ se3.exp(rng.normal(0, 0.3, 6)), target, rng)
        rivals.append((a, replace(b, candidates=(wrong, near, *b.candidates))))
    result = calibrated(rivals)
    e = off(result, T_a_b)
    assert e @ np.linalg.solve(result.covariance, e) < 30
    assert len(result.inliers) >= 27
    assert sum(j == 2 for _, j in result.inliers.values()) >= 0.9 * len(result.inliers)


def test_same_generator_same_bytes(watch, calibrated):
    pairs = watch(("plane", "line"), np.random.default_rng(3), outliers=0.2)
    first, second = (calibrated(pairs, 5) for _ in range(2))
    assert first.T_a_b.tobytes() == second.T_a_b.tobytes()
    assert first.covariance.tobytes() == second.covariance.tobytes()


def test_residuals_have_the_jacobians_they_state(watch, target, T_a_b):
    for kinds in KINDS:
        c = correspondences(watch(kinds, np.random.default_rng(4), 6), target)
        T, h, step = T_a_b @ se3.exp(np.full(6, 1e-3)), np.arange(len(c.exposure)), 1e-6
        J = c.relation.residuals(T, h)[1]
        for i, xi in enumerate(step * np.eye(6)):
            ahead, behind = (c.relation.residuals(T @ se3.exp(s * xi), h)[0] for s in (1, -1))
            np.testing.assert_allclose((ahead - behind) / (2 * step), J[..., i], atol=1e-4)


# What leaves a transform open, and what the message has to say.


@pytest.mark.parametrize("kinds", [("plane", "plane"), ("pose", "line"), ("point", "point")])
def test_two_shared_exposures(kinds, watch, calibrated):
    result = calibrated(watch(kinds, np.random.default_rng(0), 40)[:2])
    assert result.T_a_b is None
    assert "2 shared exposures are too few: 3 are the minimum" in result.reason


def turned(rng, count, tilt, about=(0.0, 1.0, 0.0)):
    """Boards at different places with a random turn about one of their own axes."""
    T = facing_boards(count, rng, tilt=0.0)
    return T @ se3.exp(np.outer(rng.uniform(-tilt, tilt, count), [*about, 0, 0, 0]))


@pytest.mark.parametrize("kinds", [k for k in KINDS if "point" not in k and k != ("pose", "pose")])
@pytest.mark.parametrize("count", [12, 100])
def test_parallel_boards(kinds, count, watch, calibrated):
    rng = np.random.default_rng(0)
    result = calibrated(watch(kinds, rng, turned(rng, count, 0.0)))
    assert result.T_a_b is None
    assert "all boards are parallel; tilt the board" in result.reason


@pytest.mark.parametrize("kinds", [("pose", "plane"), ("plane", "plane"), ("pose", "line")])
@pytest.mark.parametrize("count", [12, 100])
def test_one_place_of_the_board(kinds, count, watch, calibrated):
    rng = np.random.default_rng(0)
    pose = facing_boards(1, rng, tilt=0.2)
    result = calibrated(watch(kinds, rng, np.repeat(pose, count, axis=0)))
    assert result.T_a_b is None
    assert "the board stood at one place; move it" in result.reason


@pytest.mark.parametrize("kinds", [("pose", "plane"), ("plane", "plane")])
def test_boards_that_turn_about_one_axis(kinds, watch, calibrated):
    rng = np.random.default_rng(0)
    result = calibrated(watch(kinds, rng, turned(rng, 40, 0.7)))
    assert result.T_a_b is None
    assert "turned about one axis only; tilt the board about another" in result.reason


@pytest.mark.parametrize("kinds", [("pose", "line"), ("plane", "line")])
def test_one_line_of_all_boards(kinds, watch, calibrated, T_a_b):
    """Boards that turn about the line in which the laser sees them."""
    rng = np.random.default_rng(0)
    T_b_t = facing_boards(1, rng, tilt=0.0)[0]
    T_b_t[2, 3] = 0.0
    turns = se3.exp(np.outer(rng.uniform(-0.7, 0.7, 40), [1, 0, 0, 0, 0, 0]))
    result = calibrated(watch(kinds, rng, T_a_b @ T_b_t @ turns))
    assert result.T_a_b is None
    assert "sees the board at one place; move the board" in result.reason


def test_points_on_a_line(watch, calibrated):
    rng = np.random.default_rng(0)
    T = np.repeat(facing_boards(1, rng), 20, axis=0)
    T[:, :3, 3] += np.outer(rng.uniform(0, 1, 20), [0.6, 0.8, 0.0])
    result = calibrated(watch(("point", "point"), rng, T))
    assert result.T_a_b is None
    assert "the points lie on a line" in result.reason


def test_a_board_always_frontal_is_enough_where_the_bearing_changes(watch, calibrated, T_a_b):
    """Frontal at many bearings is not parallel: weakly determined, and the covariance says so."""
    rng = np.random.default_rng(0)
    T = facing_boards(60, rng, tilt=0.0)
    axis = np.cross([1.0, 0, 0], T[:, :3, 3] / np.linalg.norm(T[:, :3, 3], axis=1, keepdims=True))
    sine = np.linalg.norm(axis, axis=1, keepdims=True)
    T[:, :3, :3] = se3.exp_so3(axis / sine * np.arcsin(sine)) @ T[:, :3, :3]
    result = calibrated(watch(("plane", "plane"), rng, T))
    e = off(result, T_a_b)
    assert e @ np.linalg.solve(result.covariance, e) < 25


def test_a_wall_that_both_take_for_the_board(watch, calibrated):
    """The same three flat things in turn, whatever the board does: they prove nothing."""
    rng = np.random.default_rng(2)
    places = facing_boards(3, rng)
    walls = watch(("plane", "plane"), rng, places[rng.choice(3, 40, p=[0.8, 0.1, 0.1])])
    result = calibrated(walls)
    assert result.T_a_b is None
    assert "do not belong together" in result.reason


@pytest.mark.parametrize(
    ("kinds", "why"),
    [
        (("line", "line"), "its mirror image (z, roll and pitch of opposite sign) still explain"),
        (("line", "point"), "free to turn about the line"),
    ],
)
def test_what_can_never_determine(kinds, why, watch, calibrated):
    result = calibrated(watch(kinds, np.random.default_rng(0), 40))
    assert result.T_a_b is None
    assert "do not determine a transform" in result.reason
    assert why in result.reason


def test_two_lasers_cannot_tell_a_transform_from_its_mirror_image(target, T_a_b):
    """Mirror the scene in the scan plane of a: every scan, with the board's edges, is the same."""
    z, x = np.diag([1.0, 1, -1, 1]), np.diag([-1.0, 1, 1, 1])
    mirrored = z @ T_a_b @ z
    assert np.linalg.norm(se3.log(se3.inverse(mirrored) @ T_a_b)) > 0.1
    seen = 0
    for T_a_t in facing_boards(30, np.random.default_rng(0)):
        other = z @ T_a_t @ x  # the rectangle is its own mirror image
        for T, U in (
            (T_a_t, other),
            (se3.inverse(T_a_b) @ T_a_t, se3.inverse(mirrored) @ other),
        ):
            first, second = (observe("line", P, target, np.random.default_rng(1)) for P in (T, U))
            if first is None:
                continue
            assert first.geometry.start_is_edge
            assert first.geometry.end_is_edge
            np.testing.assert_allclose(first.geometry.start, second.geometry.start, atol=1e-9)
            np.testing.assert_allclose(first.geometry.end, second.geometry.end, atol=1e-9)
            seen += 1
    assert seen > 20


def test_different_points_of_one_target(watch, calibrated):
    pairs = []
    for a, b in watch(("point", "point"), np.random.default_rng(0), 10):
        g = b.candidates[0].geometry
        other = PointGeometry(g.position, g.covariance, g.target_point + 0.1)
        pairs.append((a, replace(b, candidates=(replace(b.candidates[0], geometry=other),))))
    assert "different points of the target" in calibrated(pairs).reason
