"""The command line around the functions: files, exit status, output for people and programs."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import typer

from rigcal import __version__
from rigcal.calibration import Calibration, RefinedNumber, Rejection, SensorResult
from rigcal.calibration_file import load_calibration, save_calibration
from rigcal.cli.app import make_app
from rigcal.errors import InputError, NotConnectedError, RecordingError
from rigcal.observation_file import load_observations
from rigcal.plugin import Registry, hookimpl
from rigcal.plugin.offer import OWN_NAMES
from rigcal.rig import Rig

Command = Callable[..., Any]
DETECT, CALIBRATE = import_module("rigcal.detection"), import_module("rigcal.estimation")


def test_detect_writes_observations(place: Path, command: Command) -> None:
    ran = command("detect", "rig.yaml", "recording", "--out", "new/o.npz")
    assert ran.code == 0
    observations, about = load_observations(place / "new" / "o.npz")
    assert len(observations) == 6
    assert about["inputs"]["recording"]["name"] == "recording"
    assert "bow: 1 without: too dark" in ran.out
    assert "new/o.npz" in ran.out


def test_detect_json(place: Path, command: Command) -> None:
    ran = command("detect", "rig.yaml", "recording", "--out", "o.npz", "--json")
    assert ran.code == 0
    answer = json.loads(ran.out)
    assert answer["sensors"]["stern"] == {"frames": 3, "detected": 2, "reasons": {"too dark": 1}}


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


def test_evaluate(place: Path, calibration: Calibration, command: Command) -> None:
    save_calibration("truth.yaml", calibration)
    moved = calibration.T("bow", "stern").copy()
    moved[0, 3] += 0.002
    sensors = {**calibration.sensors, "stern": SensorResult("bow", moved, np.eye(6) * 1e-6)}
    save_calibration("calibration.yaml", Calibration("bow", sensors))
    ran = command("evaluate", "calibration.yaml", "--truth", "truth.yaml", "--json")
    assert ran.code == 0
    answer = json.loads(ran.out)
    assert answer["sensors"]["stern"]["translation_mm"] == pytest.approx(2.0)
    assert answer["sensors"]["stern"]["nees"] == pytest.approx(4.0)
    assert answer["mean_rotation_deg"] == pytest.approx(0.0, abs=1e-6)
    ran = command("evaluate", "calibration.yaml", "--truth", "truth.yaml")
    assert ran.code == 0
    assert "2.000" in ran.out
    assert "not in the" not in ran.out
    save_calibration("more.yaml", Calibration("bow", {**sensors, "mast": sensors["stern"]}))
    ran = command("evaluate", "more.yaml", "--truth", "truth.yaml")
    assert "not in the truth: mast\n" in ran.out
    ran = command("evaluate", "truth.yaml", "--truth", "more.yaml")
    assert "not in the calibration: mast\n" in ran.out
    assert command("evaluate", "calibration.yaml", "--truth", "no.yaml").code == 2


def test_plugins_json(place: Path, command: Command) -> None:
    ran = command("plugins", "--json")
    assert ran.code == 0
    answer = json.loads(ran.out)
    assert answer["sensor_types"] == ["sonar"]
    assert answer["commands"] == ["fail", "ping"]
    assert answer["broken"] == []


def test_schema_is_json(place: Path, command: Command) -> None:
    ran = command("schema")
    assert ran.code == 0
    assert json.loads(ran.out)["required"] == [
        "version", "root", "targets", "sensors",
    ]  # fmt: skip


def test_schema_of_another_file(place: Path, command: Command) -> None:
    ran = command("schema", "notes")
    assert ran.code == 0
    assert json.loads(ran.out) == {"title": "notes"}
    ran = command("schema", "note")
    assert ran.code == 2
    assert "no schema of 'note', did you mean 'notes'? (has: notes, rig)" in ran.err


def test_version(command: Command) -> None:
    ran = command("--version")
    assert ran.code == 0
    assert ran.out == f"rigcal {__version__}\n"


def test_command_of_a_plugin(place: Path, command: Command) -> None:
    ran = command("ping", "you", "--loud")
    assert ran.code == 0
    assert ran.out == "pong you!\n"
    ran = command("--help")
    assert ran.code == 0
    assert "ping" in ran.out


def test_command_of_a_plugin_does_not_replace_one_of_rigcal(
    place: Path, monkeypatch: pytest.MonkeyPatch, command: Command
) -> None:
    @hookimpl
    def rigcal_commands() -> list[Any]:
        return [("evaluate", lambda: pytest.fail("it is not rigcal's")), ("hello", lambda: None)]

    module = SimpleNamespace(rigcal_commands=rigcal_commands)
    entry = SimpleNamespace(name="acme", load=lambda: module, dist=None, attr="x", module="acme")
    monkeypatch.setattr("rigcal.plugin.registry.entry_points", lambda group: [entry])
    ran = command("evaluate", "no.yaml", "--truth", "no.yaml")
    assert ran.code == 2
    assert "no.yaml: no such file" in ran.err
    assert "evaluate" not in ran.err
    assert command("hello").code == 0
    listed = command("plugins").out
    assert "broken: plugin 'acme' of this program is left out: command 'evaluate' is" in listed


def test_the_commands_of_rigcal_are_those_that_plugins_cannot_take() -> None:
    group: Any = typer.main.get_command(make_app(Registry()))
    assert list(group.commands) == list(OWN_NAMES["rigcal_commands"])


def test_unexpected_error_is_one_message_and_a_traceback_with_v(
    place: Path, monkeypatch: pytest.MonkeyPatch, command: Command
) -> None:
    monkeypatch.setattr("rigcal.rig.rig_schema", lambda registry: 1 / 0)
    ran = command("schema")
    assert ran.code == 1
    error = ran.err
    assert error.startswith("rigcal: unexpected ZeroDivisionError: division by zero\n")
    assert "Traceback" not in error
    ran = command("schema", "-v")
    assert ran.code == 1
    assert "Traceback" in ran.err


def test_command_of_a_plugin_that_fails_is_named_with_its_plugin(
    place: Path, command: Command
) -> None:
    ran = command("fail")
    assert ran == (
        2,
        "",
        "rigcal: command 'fail' of plugin 'sonar' of acme-sonar 2.0 failed with ZeroDivisionError: "
        "in the plugin; run again with -v to see where\n",
    )
    assert "Traceback" in command("fail", "--verbose").err
    assert command("fail", "--mendable") == (2, "", "rigcal: no tape\n")


def test_a_command_or_schema_that_is_missing_may_be_that_of_a_plugin(
    place: Path, command: Command
) -> None:
    hint = "plugins bring more: `rigcal plugins` lists those that are installed"
    code, out, err = command("sonnar")
    assert (code, out) == (2, "")
    assert "no command 'sonnar' (has: " in err
    assert hint in " ".join(err.replace("│", " ").split())
    assert command("schema", "scenario") == (
        2, "", f"rigcal: no schema of 'scenario' (has: notes, rig); {hint}\n"
    )  # fmt: skip


@pytest.mark.parametrize("arguments", [["sonnar"], ["detect"], ["detect", "--jobs", "0"]])
def test_wrong_usage_exits_2(place: Path, arguments: list[str], command: Command) -> None:
    assert command(*arguments).code == 2


def _write_two_targets() -> None:
    cover = "  cover: {type: checkerboard, columns: 3, rows: 2, square_size_m: 0.1}\n"
    text = Path("rig.yaml").read_text().replace("sensors:", f"{cover}sensors:")
    Path("two.yaml").write_text(text.replace("files:", "target: board, files:"))


def test_target_writes_the_page_and_says_how_large_it_is(place: Path, command: Command) -> None:
    ran = command("target", "rig.yaml", "--out", "new/board.pdf")
    assert ran.code == 0
    assert Path("new/board.pdf").read_bytes().startswith(b"%PDF")
    assert "'board' of 800 x 600 mm on a page of 830 x" in ran.out
    _write_two_targets()
    ran = command("target", "two.yaml", "--target", "cover", "-o", "cover.svg", "--json")
    assert ran.code == 0
    answer = json.loads(ran.out)
    assert answer["target"] == "cover"
    assert answer["board_mm"] == [400, 300]
    assert answer["page_mm"][0] == 430
    assert Path(answer["page"]).read_text().startswith("<?xml")
    assert command("target", "rig.yaml", "--out", "b.svg", "--quiet") == (0, "", "")


def test_target_needs_the_type_of_the_board_only(place: Path, command: Command) -> None:
    text = Path("rig.yaml").read_text().replace("sonar", "radar")
    Path("radar.yaml").write_text(text)
    assert command("target", "radar.yaml", "--out", "b.svg", "--quiet") == (0, "", "")
    Path("disc.yaml").write_text(text.replace("checkerboard", "disc").replace("root:", "rot:"))
    code, _, err = command("target", "disc.yaml", "--out", "c.svg")
    assert code == 2
    assert "disc.yaml:2: rot: unknown key, did you mean 'root'?" in err
    assert "disc.yaml:4: targets.board.type: no target type 'disc' (installed: " in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["two.yaml", "-o", "b.pdf"], "several targets; add `--target NAME`, one of board, cover"),
        (["two.yaml", "-o", "b.pdf", "--target", "bord"], "target 'bord', did you mean 'board'?"),
        (["rig.yaml", "-o", "b.doc"], "found suffix '.doc', expected one of .pdf, .ps, .svg, .png"),
        (["rig.yaml", "-o", "rig.yaml/b.pdf"], "rig.yaml/b.pdf: cannot be written"),
        (["rig.yaml", "-o", "b.png", "--px-per-mm", "100"], "too many pixels at 100 px/mm; use 23"),
    ],
)  # fmt: skip
def test_target_that_cannot_be_written_says_why(
    arguments: list[str], message: str, place: Path, command: Command
) -> None:
    _write_two_targets()
    ran = command("target", *arguments)
    assert ran.code == 2
    assert message in ran.err
