"""The command line around the functions: files, exit status, output for people and programs."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import typer

from rigcal import __version__
from rigcal.calibration import Calibration, SensorResult
from rigcal.calibration_file import save_calibration
from rigcal.cli.app import make_app
from rigcal.observation_file import load_observations
from rigcal.plugin import Registry, hookimpl
from rigcal.plugin.offer import OWN_NAMES

Command = Callable[..., Any]


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
