"""What is predicted, what is proposed, and whether it holds."""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

from rigcal.calibration import Calibration, SensorResult
from rigcal.errors import ConfigError, ObservationError
from rigcal.estimation import calibrate
from rigcal.geometry import se3
from rigcal.graph.method import Method
from rigcal.graph.numbers import NO_NUMBERS
from rigcal.planning import plan
from rigcal.planning.candidates import draw_candidates
from rigcal.planning.choice import Judge, best
from rigcal.planning.gain import weigh
from rigcal.planning.result import worst
from rigcal.planning.site import Site
from rigcal.rig import T_root_sensors

ALL = ("gauge", "left", "right", "slit")


def random_poses(bench, rig, rng, count=5):
    """Board poses that two sensors see, drawn at random."""
    site = Site.of(rig, bench.registry, T_root_sensors(rig), ())
    drawn = draw_candidates(site, dict.fromkeys(rig.sensors, 20), rng)
    return [drawn[i].T_root_t for i in rng.permutation(len(drawn))[:count]]


def sigma_of(calibration, name):
    variances = np.diagonal(calibration.sensors[name].covariance)
    return np.sqrt(variances[3:].sum()), np.sqrt(variances[:3].sum())


def worst_of(calibration, rig):
    """In units of 20 mm and 0.5 deg."""
    sizes = [
        max(mm / 0.02, rad / np.radians(0.5))
        for name in rig.sensors
        if name != rig.root
        for mm, rad in [sigma_of(calibration, name)]
    ]
    return max(sizes)


def test_more_exposures_are_predicted_to_be_better(bench):
    predicted = plan(bench.rig(*ALL), bench.registry, exposures=(10, 40, 160)).predicted
    assert list(predicted) == [10, 40, 160]
    for name in ALL[1:]:
        sizes = [predicted[n][name].size for n in predicted]
        assert sizes == sorted(sizes, reverse=True)
        # Four times as many exposures, half the sigma.
        assert sizes[2] == pytest.approx(sizes[1] / 2, rel=0.3)


def test_the_prediction_is_what_recordings_then_report(bench):
    rig = bench.rig(*ALL)
    predicted = plan(rig, bench.registry, exposures=(24,)).predicted[24]
    found = [
        calibrate(rig, bench.registry, bench.observe(rig, shown, seed))
        for seed in range(2)
        for shown in [random_poses(bench, rig, np.random.default_rng(seed), 24)]
    ]
    for name in ALL[1:]:
        mm, rad = np.median([sigma_of(c, name) for c in found], axis=0)
        assert predicted[name].translation_m == pytest.approx(mm, rel=0.35), name
        assert predicted[name].rotation_rad == pytest.approx(rad, rel=0.35), name


def test_what_was_recorded_is_judged_as_the_calibration_judges_it(bench, make_boards):
    rig = bench.rig(*ALL)
    seen = bench.observe(rig, make_boards(np.random.default_rng(0), 20))
    so_far = plan(rig, bench.registry, seen).recorded
    calibration = calibrate(rig, bench.registry, seen)
    for name in ALL[1:]:
        mm, rad = sigma_of(calibration, name)
        assert so_far[name].translation_m == pytest.approx(mm, rel=0.05)
        assert so_far[name].rotation_rad == pytest.approx(rad, rel=0.05)


def test_five_proposals_shrink_the_worst_sigma_more_than_five_at_random(bench, make_boards):
    rig = bench.rig(*ALL)
    shown = make_boards(np.random.default_rng(1), 14)
    result = plan(rig, bench.registry, bench.observe(rig, shown))
    assert len(result.proposals) == 5

    def after(more):
        return worst_of(calibrate(rig, bench.registry, bench.observe(rig, [*shown, *more])), rig)

    proposed = after([p.T_root_t for p in result.proposals])
    at_random = [after(random_poses(bench, rig, np.random.default_rng(seed))) for seed in range(5)]
    assert proposed < 0.8 * np.median(at_random)
    # What was promised is what came.
    assert result.after[worst(result.after)].size == pytest.approx(proposed, rel=0.25)


def test_proposals_join_a_sensor_that_has_seen_nothing(bench, make_boards):
    rig = bench.rig(*ALL)
    shown = make_boards(np.random.default_rng(2), 16)
    blind = [o for o in bench.observe(rig, shown) if o.sensor != "right"]
    result = plan(rig, bench.registry, blind)
    assert result.unjoined == ("right",)
    assert np.isinf(result.recorded["right"].translation_m)
    assert np.isfinite(result.recorded["left"].translation_m)
    assert sum("right" in p.seen_by for p in result.proposals) >= 3
    assert all(len(p.seen_by) >= 2 for p in result.proposals)
    assert result.after["right"].size < 1


def test_a_laser_that_has_seen_nothing_is_joined_by_what_is_proposed(bench, make_boards):
    """It takes five exposures with one partner: the calibration then accepts their pair."""
    rig = bench.rig("gauge", "left", "slit")
    shown = make_boards(np.random.default_rng(12), 12)
    blind = [o for o in bench.observe(rig, shown) if o.sensor != "slit"]
    result = plan(rig, bench.registry, blind)
    common = set.intersection(*({*p.seen_by} for p in result.proposals))
    assert "slit" in common
    assert common & {"gauge", "left"}
    boards = [*shown, *(p.T_root_t for p in result.proposals)]
    seen = [
        o for o in bench.observe(rig, boards) if o.sensor != "slit" or int(o.exposure) >= len(shown)
    ]
    error = se3.log(
        se3.inverse(calibrate(rig, bench.registry, seen, method=Method(accept_weak=True)).T(
            "gauge", "slit")) @ T_root_sensors(rig)["slit"]
    )  # fmt: skip
    assert np.linalg.norm(error[3:]) < 0.05


def test_groups_that_nothing_links_are_linked(bench, make_boards):
    """A laser and a camera that look ahead, and a laser and a camera that look back."""
    changes = {"mute": {"type": "gauge", "pose": {"parent": "gauge", "rpy_deg": [0, 0, 100]}}}
    changes["back"] = {"pose": {"parent": "gauge", "rpy_deg": [-90, 0, 45]}}
    rig = bench.rig("gauge", "left", "mute", "back", changes=changes)
    rng = np.random.default_rng(3)
    shown = [*make_boards(rng, 12), *make_boards(rng, 12, toward=2.2)]
    result = plan(rig, bench.registry, bench.observe(rig, shown))
    assert result.unjoined == ("mute", "back")
    ahead, behind = {"gauge", "left"}, {"mute", "back"}
    assert any(ahead & {*p.seen_by} and behind & {*p.seen_by} for p in result.proposals)
    assert result.after["back"].size < 1


def test_parallel_boards_are_followed_by_tilted_ones(bench, make_boards):
    rig = bench.rig("left", "gauge", changes={"left": {"pose": None}, "gauge": {
        "pose": {"parent": "left", "translation_m": [0.0, 0.2, -0.1], "rpy_deg": [90.0, -90.0, 0.0]}
    }})  # fmt: skip
    T_ahead = se3.transform(np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]), np.zeros(3))
    shown = [T_ahead @ T for T in make_boards(np.random.default_rng(4), 12, tilt_deg=0.0)]
    result = plan(rig, bench.registry, bench.observe(rig, shown))
    assert np.isinf(result.recorded["gauge"].translation_m)
    # Of the many poses that explain parallel boards, the one in the rig file is taken.
    np.testing.assert_allclose(result.T_root_s["gauge"], T_root_sensors(rig)["gauge"], atol=1e-9)
    normals = np.array([p.T_root_t[:3, 2] for p in result.proposals])
    tilts_deg = np.degrees(np.arccos(normals @ shown[0][:3, 2]))
    assert np.sort(tilts_deg)[1:].min() > 20
    assert result.after["gauge"].size < 1
    calibrated = calibrate(
        rig, bench.registry,
        bench.observe(rig, [*shown, *(p.T_root_t for p in result.proposals)]),
        method=Method(accept_weak=False),
    )  # fmt: skip
    assert not calibrated.verdict.withheld


def test_boards_can_be_shown_where_they_are_proposed(bench, make_boards):
    rig = bench.rig(*ALL)
    shown = make_boards(np.random.default_rng(5), 10)
    T_root_s = T_root_sensors(rig)
    for proposal in plan(rig, bench.registry, bench.observe(rig, shown)).proposals:
        corners = se3.apply(
            proposal.T_root_t, np.array([[x, y, 0] for x in (-0.5, 0.5) for y in (-0.4, 0.4)])
        )
        assert corners[:, 2].min() > -1.0
        assert corners[:, 2].max() < 1.5
        for name in proposal.seen_by:
            p_s = se3.apply(se3.inverse(T_root_s[name]), corners)
            assert 0.4 < np.linalg.norm(p_s, axis=1).min() < 4.5
            n = se3.inverse(T_root_s[name])[:3, :3] @ proposal.T_root_t[:3, 2]
            assert n @ p_s.mean(axis=0) < 0, "it faces the sensor"


def test_a_board_is_not_put_through_the_rig(bench):
    site = Site.of(bench.rig(*ALL), bench.registry, T_root_sensors(bench.rig(*ALL)), ())
    target = site.targets["board"]
    upright = np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]])
    for place, clear in [((2, 0, 0), True), ((0.4, 0, 0), False), ((0.15, 1.6, 0), True)]:
        T = se3.transform(upright, np.array(place, dtype=float))
        assert site.is_clear(target, T) is clear, place
    between = se3.transform(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.array([0.6, 0.0, 0]))
    assert not site.is_clear(target, between)


def test_sensors_that_cannot_be_planned_for_are_named(bench, make_boards):
    rig = bench.rig("gauge", "left", "mute", "back")
    result = plan(rig, bench.registry, bench.observe(bench.rig("gauge", "left"), make_boards(
        np.random.default_rng(6), 10)))  # fmt: skip
    assert result.unplanned == {
        "mute": "its type 'mute' does not simulate what it would see",
        "back": "no board pose was found that it sees together with another sensor",
    }
    # They do not keep the others from being planned for.
    assert result.after["left"].size < result.recorded["left"].size
    assert all({*p.seen_by} == {"gauge", "left"} for p in result.proposals)


def test_a_root_that_cannot_be_planned_for_is_no_reference(bench):
    """Poses are given from another sensor to the root; sigmas are those seen from the first."""
    rig = bench.rig("mute", "left", "gauge")
    result = plan(rig, bench.registry, exposures=(20,))
    assert result.reference == "left"
    sigmas = result.predicted[20]
    assert {s: bool(np.isfinite(v.size)) for s, v in sigmas.items()} == {
        "mute": False, "gauge": True}  # fmt: skip
    expected = se3.inverse(T_root_sensors(bench.rig("gauge", "mute"))["mute"])
    np.testing.assert_allclose(result.T_root_s["gauge"], expected)


def test_a_sensor_that_says_not_where_it_sees_is_thought_to_see_all_around(bench):
    eye = bench.registry.sensor_type("eye")
    everywhere = {"back": replace(eye, sees=None)}
    nowhere = {"back": replace(eye, sees=lambda p_s, config: np.zeros(len(p_s), bool))}
    rig = bench.rig("gauge", "back")
    site = Site.of(rig, bench.registry, T_root_sensors(rig), ())
    seen, unseen = (
        draw_candidates(
            replace(site, kinds={**site.kinds, **kinds}), {"back": 8}, np.random.default_rng(2)
        )
        for kinds in (everywhere, nowhere)
    )
    assert {p.seen_by for p in seen} == {("gauge", "back")}, "before the laser, at its own back"
    assert unseen == []


def test_one_sensor_that_has_seen_the_board_is_a_beginning(bench, make_boards):
    rig = bench.rig("gauge", "left")
    seen = bench.observe(rig, make_boards(np.random.default_rng(15), 6))
    alone = [o for o in seen if o.sensor == "left"]
    result = plan(rig, bench.registry, alone)
    assert result.unjoined == ("left",)
    assert np.isinf(result.recorded["left"].size)
    assert np.isfinite(result.after["left"].size)
    assert {s for p in result.proposals for s in p.seen_by} == {"gauge", "left"}


def test_boards_held_every_way_round_do_not_say_where_is_up(bench, make_boards):
    rig = bench.rig("gauge", "left")
    held = [("board", T) for T in make_boards(np.random.default_rng(16), 8, tilt_deg=10.0)]
    over = [("board", T @ np.diag([-1.0, -1, 1, 1])) for _, T in held]
    fallen = [("board", T @ se3.transform(se3.exp_so3(np.array([0, 0, np.pi / 2])), np.zeros(3)))
              for _, T in held]  # fmt: skip

    def up(boards):
        return Site.of(rig, bench.registry, T_root_sensors(rig), boards).up

    np.testing.assert_array_equal(up([*held, *over]), [0, 0, 1])
    np.testing.assert_allclose(np.abs(up(fallen)), [0, 1, 0], atol=0.1)


def test_a_sensor_without_any_pose_is_asked_for_one(bench, make_boards):
    rig = bench.rig(*ALL, changes={"right": {"pose": None}})
    with pytest.raises(ConfigError, match="gives no pose of right as seen from the root 'gauge'"):
        plan(rig, bench.registry)
    blind = [
        o for o in bench.observe(bench.rig(*ALL), make_boards(np.random.default_rng(7), 12))
        if o.sensor != "right"
    ]  # fmt: skip
    with pytest.raises(ConfigError, match=r"neither the observations .* join right to the root"):
        plan(rig, bench.registry, blind)


def test_a_rig_whose_sensors_share_no_view_has_no_plan(bench):
    rig = bench.rig("gauge", "back")
    with pytest.raises(ConfigError, match="no two sensors of rig"):
        plan(rig, bench.registry)


def test_poses_of_a_calibration_will_do(bench, make_boards):
    known = calibrate(
        bench.rig(*ALL), bench.registry,
        bench.observe(bench.rig(*ALL), make_boards(np.random.default_rng(8), 16)),
    )  # fmt: skip
    bare = bench.rig(*ALL, changes={n: {"pose": None} for n in ALL})
    predicted = plan(bare, bench.registry, calibration=known, exposures=(20,)).predicted[20]
    expected = plan(bench.rig(*ALL), bench.registry, exposures=(20,)).predicted[20]
    for name in ALL[1:]:
        assert predicted[name].size == pytest.approx(expected[name].size, rel=0.3)


def test_what_was_made_with_another_rig_is_not_passed_over(bench, make_boards):
    rig = bench.rig("gauge", "left")
    seen = bench.observe(bench.rig(*ALL), make_boards(np.random.default_rng(8), 4))
    with pytest.raises(ObservationError, match="which the rig does not name"):
        plan(rig, bench.registry, seen)
    other = Calibration("gauge", {n: SensorResult("gauge", np.eye(4)) for n in ("gauge", "right")})
    with pytest.raises(ConfigError, match="of gauge, right places none of left of this rig"):
        plan(rig, bench.registry, calibration=other)


def test_the_same_seed_gives_the_same_plan(bench, make_boards):
    rig = bench.rig(*ALL)
    seen = bench.observe(rig, make_boards(np.random.default_rng(9), 6))
    first, second = (plan(rig, bench.registry, seen, seed=1) for _ in range(2))
    assert [p.words for p in first.proposals] == [p.words for p in second.proposals]
    assert first.after == second.after


def test_poses_are_good_together_and_not_each_alone(bench, make_boards, monkeypatch):
    """Five that are each the best beside what was recorded are not the best five."""
    rig = bench.rig(*ALL)
    seen = bench.observe(rig, make_boards(np.random.default_rng(10), 8))

    def worst_after():
        after = plan(rig, bench.registry, seen).after
        return after[worst(after)].size

    together, first = worst_after(), []

    def best_alone(judge, known, offered):
        first.append(known)
        return best(judge, first[0], offered)

    monkeypatch.setattr(import_module("rigcal.planning.plan"), "best", best_alone)
    assert together < 0.85 * worst_after()


FIXED = {"back": {"fixed": True}}
BEHIND = {"mute": {"type": "gauge", "pose": {
    "parent": "gauge", "translation_m": [-0.2, 0.1, 0.0], "rpy_deg": [0, 0, 180]}}}  # fmt: skip


def test_fixed_sensors_stay_where_they_are_fixed(bench, make_boards):
    """A camera that looks back, fixed, joins the laser behind; one to the right saw nothing."""
    names = ("gauge", "left", "back", "mute", "right")
    rig, rng = bench.rig(*names, changes=FIXED | BEHIND), np.random.default_rng(13)
    shown = [*make_boards(rng, 12), *make_boards(rng, 12, toward=np.pi)]
    seen = bench.observe(rig, shown)
    off = {"pose": {**BEHIND["mute"]["pose"], "translation_m": [-0.1, 0.2, 0.1]}}
    rough = bench.rig(*names, changes=FIXED | {"mute": BEHIND["mute"] | off})
    for blind in (
        [o for o in seen if o.sensor != "right"],
        [replace(o, candidates=(), reason="covered") if o.sensor == "right" else o for o in seen],
    ):
        result = plan(rough, bench.registry, blind)
        assert result.unjoined == ("right",)
        np.testing.assert_allclose(result.T_root_s["back"], T_root_sensors(rig)["back"])
        apart = result.T_root_s["mute"][:3, 3] - T_root_sensors(rig)["mute"][:3, 3]
        assert np.linalg.norm(apart) < 0.03, "as it was measured, not as it was guessed"


def test_where_all_is_given_there_is_nothing_to_plan(bench, make_boards):
    rig = bench.rig("gauge", "left", changes={"left": {"fixed": True}})
    seen = bench.observe(rig, make_boards(np.random.default_rng(14), 6))
    with pytest.raises(ConfigError, match=r"\(gauge, left\) are given: take `fixed` out"):
        plan(rig, bench.registry, seen)


def test_information_of_a_pose_is_that_of_its_sensors_only(bench):
    rig = bench.rig(*ALL)
    site = Site.of(rig, bench.registry, T_root_sensors(rig), ())
    rng = np.random.default_rng(11)
    pool = weigh(site, draw_candidates(site, {"left": 4}, rng), NO_NUMBERS, {}, rng)
    scales = {"left": 3.0, "gauge": 3.0, "right": 3.0, "slit": 3.0}
    noisier = weigh(site, pool.poses, NO_NUMBERS, scales, rng)
    for pose, M, M_noisier in zip(pool.poses, pool.information, noisier.information, strict=True):
        told = [M[6 * i : 6 * i + 6].any() for i in range(len(ALL))]
        assert told == [name in pose.seen_by for name in ALL]
        assert np.trace(M_noisier) == pytest.approx(np.trace(M) / 9, rel=0.1)
        # No exposure tells where the rig as a whole stands: all sensors moved with the root.
        moved = np.vstack([se3.adjoint(se3.inverse(site.T_root_s[name])) for name in ALL])
        assert np.abs(M @ moved).max() < 1e-4 * np.abs(M).max()


def test_open_directions_are_not_given_a_sigma(bench):
    judge = Judge(("a", "b"), frozenset({"a"}), frozenset({"b"}))
    M = np.zeros((12, 12))
    M[6:, 6:] = np.diag([1e6, 1e6, 1e6, 1e6, 1e6, 0.0])
    (sigma,) = judge.sigmas(M).values()
    assert np.isinf(sigma.translation_m)
    assert sigma.rotation_rad == pytest.approx(np.sqrt(3) * 1e-3, rel=1e-3)
