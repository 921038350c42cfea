"""`rigcal plan` for a rig of cameras and lasers: tables, words, picture, JSON."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import yaml

from rigcal.errors import NotDeterminedError
from rigcal.estimation import calibrate
from rigcal.observation_file import save_observations
from rigcal.planning import plan
from rigcal.report import write_plan_picture

ALL = ("lidar", "left", "right", "scan")
UPRIGHT = (0.0, 0.0, 0.6)


@pytest.fixture
def run(command):
    return partial(command, "plan")


@pytest.fixture
def files(cart, make_boards, tmp_path):
    """A rig file, and observations of 12 boards straight ahead."""
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(cart.content(ALL)))
    rng = np.random.default_rng(20)
    seen = cart.record(rng, make_boards(rng, 12, 15.0, (1.6, 2.4)), ALL)
    save_observations(tmp_path / "observations.npz", seen, {})
    return tmp_path / "rig.yaml", tmp_path / "observations.npz"


def test_from_the_rig_file_alone_sigmas_are_predicted(run, files):
    code, text, _ = run(files[0], "--poses", 15, "--poses", 30, "--json")
    assert code == 0
    answer = json.loads(text)
    assert list(answer["predicted"]) == ["15", "30"]
    for name in ("left", "right", "scan"):
        assert (
            0 < answer["predicted"]["30"][name]["mm"] < answer["predicted"]["15"][name]["mm"] < 20
        )
    assert answer["recorded"] is None
    assert answer["proposals"] == []


def test_a_table_is_printed_for_people(run, files):
    code, text, _ = run(files[0], "--poses", 15)
    assert code == 0
    assert "Predicted sigma (mm, deg) as seen from lidar" in text
    assert "15 exposures" in text


def test_from_observations_five_board_poses_are_proposed(run, files, tmp_path):
    picture = tmp_path / "plan.svg"
    code, text, _ = run(files[0], "--observations", files[1], "--out", picture)
    assert code == 0
    assert "with the 5 poses below" in text
    places = [line for line in text.splitlines() if line[:2] in ("1.", "2.", "3.", "4.", "5.")]
    assert len(places) == 5
    assert all(" m in front of " in p or " m to the " in p for p in places)
    assert text.count("seen by ") == 5
    drawn = picture.read_text()
    assert all(place[3:] in drawn for place in places)
    assert all(name in drawn for name in ALL)


def test_a_plan_is_drawn_the_same_on_every_run(cart, make_boards, tmp_path):
    rng = np.random.default_rng(23)
    rig = cart.rig(("lidar", "left"))
    result = plan(rig, cart.registry, cart.record(rng, make_boards(rng, 10), ("lidar", "left")))
    for name in ("a.svg", "b.svg", "a.png", "b.png"):
        write_plan_picture(tmp_path / name, result, rig, cart.registry)
    for suffix in (".svg", ".png"):
        first, second = ((tmp_path / n).with_suffix(suffix).read_bytes() for n in "ab")
        assert first == second


def test_the_answer_for_programs_says_the_same(run, files, tmp_path):
    picture = tmp_path / "plan.png"
    code, text, _ = run(files[0], "--observations", files[1], "--json", "--out", picture)
    answer = json.loads(text)
    assert code == 0
    assert answer["picture"] == str(picture)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert len(answer["proposals"]) == 5
    last = answer["proposals"][-1]
    assert np.shape(last["T_root_target"]) == (4, 4)
    worst = [max(s["mm"] / 20, s["deg"] / 0.5) for s in answer["recorded"].values()]
    after = [max(s["mm"] / 20, s["deg"] / 0.5) for s in last["sigmas"].values()]
    assert max(after) < 0.8 * max(worst)


def test_what_cannot_be_done_is_said(run, files, tmp_path):
    code, _, error = run(files[0], "--observations", files[1], "--out", tmp_path / "plan.bmp")
    assert (code, "ends in .png or .svg" in error) == (2, True)
    code, _, error = run(files[0], "--observations", files[1], "--poses", 10)
    assert (code, "leave it out" in error) == (2, True)
    content = yaml.safe_load(files[0].read_text())
    del content["sensors"]["scan"]["pose"]
    files[0].write_text(yaml.safe_dump(content))
    code, _, error = run(files[0])
    assert (code, "gives no pose of scan" in error) == (2, True)


def test_a_level_scan_of_upright_boards_is_given_leaning_ones(cart, make_boards):
    """No pose is known beforehand: one of many that explain the recording will do."""
    rng = np.random.default_rng(21)
    boards = make_boards(rng, 16, 30.0, (1.2, 3.0), UPRIGHT)
    rig = cart.rig(("left", "scan"))
    seen = cart.record(rng, boards, ("left", "scan"))
    result = plan(rig, cart.registry, seen)
    assert np.isinf(result.recorded["scan"].translation_m)
    up = -np.eye(3)[1]  # of a camera, which is the root
    lean = [abs(np.degrees(np.arcsin(p.T_root_t[:3, 2] @ up))) for p in result.proposals]
    assert sorted(lean)[-3:][0] > 10
    more = [cart.truth["left"] @ p.T_root_t for p in result.proposals]
    calibrated = calibrate(rig, cart.registry, cart.record(rng, [*boards, *more], ("left", "scan")))
    assert not calibrated.verdict.withheld


def test_a_verdict_that_falls_short_points_to_the_plan(cart, make_boards):
    rng = np.random.default_rng(22)
    seen = cart.record(rng, make_boards(rng, 16, 30.0, (1.2, 3.0), UPRIGHT), ("left", "scan"))
    with pytest.raises(NotDeterminedError, match=r"`rigcal plan RIG --observations \S+` says"):
        calibrate(cart.rig(("left", "scan")), cart.registry, seen)


def test_a_lens_that_is_refined_is_not_taken_as_known(cart, make_boards):
    rng = np.random.default_rng(24)
    seen = cart.record(rng, make_boards(rng, 14), ("left", "right"))
    free = cart.rig(("left", "right"), {"right": {"refine": ["lens"]}})
    so_far = plan(free, cart.registry, seen)
    calibrated = calibrate(free, cart.registry, seen)
    sigma = np.sqrt(np.diagonal(calibrated.sensors["right"].covariance)[3:].sum())
    assert so_far.recorded["right"].translation_m == pytest.approx(sigma, rel=0.05)
    held = plan(cart.rig(("left", "right")), cart.registry, seen)
    assert so_far.after["right"].size > 1.5 * held.after["right"].size
    more = [cart.truth["left"] @ p.T_root_t for p in so_far.proposals]
    again = calibrate(
        free, cart.registry, [*seen, *_renamed(cart.record(rng, more, ("left", "right")))]
    )
    sigma = np.sqrt(np.diagonal(again.sensors["right"].covariance)[3:].sum())
    assert so_far.after["right"].translation_m == pytest.approx(sigma, rel=0.2)


def _renamed(observations):
    return [replace(o, exposure=f"more {o.exposure}") for o in observations]
