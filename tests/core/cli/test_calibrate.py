"""`rigcal calibrate`: results, their provenance, and what is left where there are none."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigcal import __version__
from rigcal.calibration import Calibration, RefinedNumber, Rejection, SensorResult
from rigcal.calibration_file import load_calibration
from rigcal.errors import InputError, NotConnectedError, RecordingError
from rigcal.observation_file import load_observations
from rigcal.rig import Rig

Command = Callable[..., Any]
DETECT, CALIBRATE = import_module("rigcal.detection"), import_module("rigcal.estimation")


def test_calibrate_writes_results_and_says_where(place: Path, command: Command) -> None:
    ran = command("calibrate", "rig.yaml", "recording", "--out", "result")
    assert ran.code == 0
    names = {p.name for p in (place / "result").iterdir()}
    assert names == {"calibration.yaml", "observations.npz", "report.html"}
    for expected in (
        "stern", "1500.00", "90.0000", "20 mm", "bow: 1 (3): too dark",
        "warning: stern: few exposures", "result/calibration.yaml",
    ):  # fmt: skip
        assert expected in ran.out


def test_calibration_tells_what_it_was_made_from(place: Path, command: Command) -> None:
    command("calibrate", "rig.yaml", "recording", "--out", "a", "--no-report", "-q")
    provenance = load_calibration("a/calibration.yaml").provenance
    assert provenance["seed"] == 0
    assert isinstance(provenance["versions"], dict)
    assert provenance["versions"]["acme-sonar"] == "2.0"
    assert provenance["versions"]["rigcal"] == __version__
    assert isinstance(provenance["inputs"], dict)
    assert provenance["inputs"]["recording"]["name"] == "recording"
    # From the observations of that run: the same bytes.
    command("calibrate", "rig.yaml", "a/observations.npz", "--out", "b", "--no-report", "-q")
    first, second = (Path(d, "calibration.yaml").read_bytes() for d in "ab")
    assert first == second
    (place / "recording" / "bow" / "1.csv").write_text("1,2,4")
    command("calibrate", "rig.yaml", "recording", "--out", "c", "--no-report", "-q")
    assert Path("c/calibration.yaml").read_bytes() != first


def test_what_a_second_look_finds_is_saved_and_told(
    place: Path, monkeypatch: pytest.MonkeyPatch, command: Command
) -> None:
    def look_again(rig: Rig, registry: object, data: object, seen: Any, *_: object) -> Any:
        return [replace(o, candidates=seen[0].candidates) for o in seen]

    run = ("calibrate", "rig.yaml")
    options = ("--no-report", "-q")
    monkeypatch.setattr("rigcal.second_look.look_again", look_again)
    assert command(*run, "recording", "--out", "a", *options).code == 0
    assert len([o for o in load_observations("a/observations.npz")[0] if o.candidates]) == 4
    assert command(*run, "recording", "--out", "b", "--second-look", *options).code == 0
    assert len([o for o in load_observations("b/observations.npz")[0] if o.candidates]) == 6
    assert load_calibration("b/calibration.yaml").provenance["second_look"] == {
        "bow": 1, "stern": 1,
    }  # fmt: skip
    # Those observations are told apart from what detection alone finds, also when used again.
    assert command(*run, "b/observations.npz", "--out", "c", *options).code == 0
    assert Path("b/calibration.yaml").read_bytes() == Path("c/calibration.yaml").read_bytes()
    ran = command(*run, "b/observations.npz", "--out", "d", "--second-look", *options)
    assert ran.code == 2
    assert "--second-look searches a recording again, and b/observations.npz holds" in ran.err
    # Nothing is estimated twice where nothing was found.
    monkeypatch.setattr("rigcal.second_look.look_again", lambda *arguments: arguments[3])
    assert command(*run, "recording", "--out", "e", "--second-look", *options).code == 0
    assert Path("a/calibration.yaml").read_bytes() == Path("e/calibration.yaml").read_bytes()


def test_calibrate_prints_what_was_refined_and_the_most_frequent_reasons(
    place: Path, monkeypatch: pytest.MonkeyPatch, calibration: Calibration, command: Command
) -> None:
    scale = RefinedNumber(1.0021, 0.0004, 1.0)
    bias = RefinedNumber(-0.012, 0.001, 0.0, "m")
    stern = SensorResult("bow", np.eye(4), refined={"range_bias": bias})
    lost = [Rejection("bow", str(i), f"{i}.csv", f"reason {i % 14}") for i in range(40)]
    lost += [Rejection("stern", str(i), f"{i}.csv", "deaf") for i in range(10)]
    result = replace(
        calibration,
        sensors={"bow": calibration.sensors["bow"], "stern": stern},
        refined_targets={"board": {"scale": scale}},
        rejected=tuple(lost),
    )
    monkeypatch.setattr(CALIBRATE, "calibrate", lambda *_, **__: result)
    ran = command("calibrate", "rig.yaml", "recording", "--out", "r", "--no-report")
    assert ran.code == 0
    rows = [line.split() for line in ran.out.splitlines()]
    assert ["stern", "range_bias", "-12", "mm", "1", "mm", "0", "mm"] in rows
    assert ["board", "scale", "1.0021", "0.0004", "1"] in rows
    assert "sigma mm" not in ran.out  # there is no covariance of any
    assert "Left out: 50 observations\n  stern: 10 (0, 1, 2, 3, 4, 5, 6, 7, ...): deaf\n" in ran.out
    assert "  bow: 3 (0, 14, 28): reason 0\n" in ran.out
    assert "  bow: 2 (13, 27): reason 13\n" not in ran.out
    assert "  ... and 3 more reasons in calibration.yaml\n" in ran.out


def test_result_that_cannot_be_replaced_is_told_before_any_work(
    place: Path, monkeypatch: pytest.MonkeyPatch, command: Command
) -> None:
    (place / "r" / "report.html").mkdir(parents=True)
    monkeypatch.setattr(DETECT, "detect", lambda *_: pytest.fail("work was lost"))
    ran = command("calibrate", "rig.yaml", "recording", "--out", "r")
    assert ran.code == 2
    assert "r/report.html: cannot be replaced: " in ran.err


def test_calibrate_json_is_the_calibration(place: Path, command: Command) -> None:
    ran = command("calibrate", "rig.yaml", "recording", "--out", "r", "--no-report", "--json")
    assert ran.code == 0
    answer = json.loads(ran.out)
    assert answer["files"]["calibration"] == "r/calibration.yaml"
    assert answer["sensors"]["stern"]["translation_m"]["x"] == 1.5


def test_quiet_prints_nothing(place: Path, command: Command) -> None:
    ran = command("calibrate", "rig.yaml", "recording", "--out", "r", "--no-report", "-q")
    assert ran.code == 0
    assert (ran.out, ran.err) == ("", "")


def test_data_without_an_answer_exit_1_and_keep_the_observations(
    place: Path, monkeypatch: pytest.MonkeyPatch, command: Command
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise NotConnectedError("stern shares no exposure with bow")

    monkeypatch.setattr(CALIBRATE, "calibrate", refuse)
    ran = command("calibrate", "rig.yaml", "recording", "--out", "r")
    assert ran.code == 1
    assert ran.err == "rigcal: stern shares no exposure with bow\n"
    kept = sorted(p.name for p in (place / "r").iterdir())
    assert kept == ["observations.npz", "verdict.yaml"]


@pytest.mark.parametrize(
    ("module", "function", "error", "status", "left"),
    [
        ("rigcal.detection", "detect", RecordingError("cut short"), 2, set()),
        ("rigcal.estimation", "calibrate", MemoryError(), 1, {"observations.npz"}),
        (
            "rigcal.report", "write_report", InputError("disk full"), 2,
            {"calibration.yaml", "observations.npz"},
        ),
    ],
)  # fmt: skip
def test_a_run_that_fails_leaves_nothing_of_the_one_before(
    module: str,
    function: str,
    error: Exception,
    status: int,
    left: set[str],
    place: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: Command,
) -> None:
    out = place / "r"
    out.mkdir()
    for name in ("calibration.yaml", "observations.npz", "report.html", "verdict.yaml"):
        (out / name).write_text("of the run before")
    (out / "notes.txt").write_text("mine")

    def refuse(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(import_module(module), function, refuse)
    assert command("calibrate", "rig.yaml", "recording", "--out", "r").code == status
    assert {p.name for p in out.iterdir()} == left | {"notes.txt"}
    assert all(b"before" not in (out / name).read_bytes() for name in left)


@pytest.mark.parametrize("mistyped", [("rig.yml", "recording"), ("rig.yaml", "recordin")])
def test_a_mistyped_name_costs_no_result(
    mistyped: tuple[str, str], place: Path, command: Any
) -> None:
    (place / "r").mkdir()
    kept = {"calibration.yaml", "observations.npz", "report.html", "verdict.yaml"}
    for name in kept:
        (place / "r" / name).write_text("of the run before")
    assert command("calibrate", *mistyped, "--out", "r").code == 2
    assert {p.name for p in (place / "r").iterdir()} == kept


def test_observations_in_the_folder_itself_are_calibrated_again(
    place: Path, command: Command
) -> None:
    assert command("calibrate", "rig.yaml", "recording", "--out", "r", "-q").code == 0
    assert command("calibrate", "rig.yaml", "r/observations.npz", "--out", "r", "-q").code == 0


def test_unusable_out_is_told_before_any_work(
    place: Path, monkeypatch: pytest.MonkeyPatch, command: Command
) -> None:
    monkeypatch.setattr(DETECT, "detect", lambda *_: pytest.fail("work was lost"))
    ran = command("calibrate", "rig.yaml", "recording", "--out", "rig.yaml/x")
    assert ran.code == 2
    assert "rig.yaml/x: cannot be made a folder" in ran.err
