"""What a user reads of plugins that are wrong; and what does not use them goes on."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest

from rigcal.plugin import (
    Candidate,
    Detection,
    Exporter,
    Message,
    PointGeometry,
    RecordingError,
    SensorConfig,
    SensorType,
    hookimpl,
)

HERE = Path(__file__).parent
RIG = """\
version: 1
root: bow
targets: {board: {type: checkerboard, columns: 8, rows: 5, square_size_m: 0.1}}
sensors: {bow: {type: sonar, files: "*.csv"}}
"""


class SonarConfig(SensorConfig, frozen=True):
    type: Literal["sonar"] = "sonar"


def _decode(message: Message, config: object) -> str:
    text: str = message.value.read_text()
    if text == "damaged":
        raise RecordingError(f"{message.origin}: found 'damaged', expected a range in m")
    if text == "leave":
        sys.exit(9)
    return str(float(text)) if text[0].isdigit() else text


def _detect(frame: str, config: object, target: object) -> Any:
    point = PointGeometry(np.ones(3), np.eye(3), np.zeros(3))
    match frame:
        case "raise":
            raise ZeroDivisionError("division by zero")
        case "exit":
            sys.exit(9)
        case "None":
            return None
        case "nan":
            return Detection((Candidate(replace(point, position=np.full(3, np.nan)), {}),))
        case "flat":
            return Detection((Candidate(replace(point, covariance=np.eye(2)), {}),))
    return Detection((Candidate(point, {}),))


SONAR = SensorType("sonar", SonarConfig, (".csv",), _decode, _detect)


def _offering(hook: str, *offers: object) -> object:
    def answer() -> list[object]:
        return list(offers)

    answer.__name__ = hook
    return SimpleNamespace(**{hook: hookimpl(answer)})


def _sensors(*types: object) -> object:
    return _offering("rigcal_sensor_types", *types)


def _ping() -> None:
    """Ping."""


def _turn(angle: object) -> None:
    """Turn."""


# Typical: a name that is imported for type checkers only.
_turn.__annotations__["angle"] = "Angle"


def _failing(error: BaseException) -> Callable[[], object]:
    def load() -> object:
        raise error

    return load


class PingConfig(SensorConfig, frozen=True):
    type: Literal["ping"] = "ping"


PING = replace(SONAR, name="ping", config=PingConfig)
WRONG: dict[str, Callable[[], object]] = {
    "library": _failing(ModuleNotFoundError("No module named 'libradar'")),
    "syntax": _failing(SyntaxError("invalid syntax (acme.py, line 3)")),
    "exits": _failing(SystemExit(3)),
    "misspelt": lambda: _offering("rigcal_sensor_typs"),
    "object": lambda: _sensors("sonar"),
    "contract": lambda: _sensors(replace(PING, contract=7)),
    "function": lambda: _sensors(replace(PING, detect=None)),
    "definition": lambda: _sensors(replace(PING, message_definitions={"acme_msgs/msg/Ping": 3})),
    "literal": lambda: _sensors(replace(PING, config=SonarConfig)),
    "nothing": lambda: SimpleNamespace(version=1),
    "twice-a": lambda: _sensors(PING),
    "twice-b": lambda: _sensors(PING),
    "commands": lambda: _offering("rigcal_commands", _ping),
    "own": lambda: _offering("rigcal_commands", ("calibrate", _ping)),
    "typer": lambda: _offering("rigcal_commands", ("turn", _turn)),
    "formats": lambda: _offering("rigcal_recording_formats", ".clf"),
    "exporters": lambda: _offering("rigcal_exporters", Exporter("urdf", "for robots", "text")),  # type: ignore[arg-type]
}


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """A sonar that works, among plugins that are wrong in every way."""
    entries = [
        SimpleNamespace(
            name=name, load=load, dist=SimpleNamespace(name=f"acme-{name}", version="2.0")
        )
        for name, load in {"sonar": lambda: _sensors(SONAR), **WRONG}.items()
    ]
    monkeypatch.setattr("rigcal.plugin.registry.entry_points", lambda group: entries)


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    path = tmp_path / "rig.yaml"
    path.write_text(RIG)
    return path


def _check(name: str, text: str) -> None:
    path = HERE / "messages" / f"{name}.txt"
    if "RIGCAL_UPDATE_GOLDEN" in os.environ:
        path.write_text(text)
    assert text == path.read_text()


@pytest.mark.usefixtures("installed")
def test_each_mistake_is_named_with_its_distribution(command: Any) -> None:
    code, out, _ = command("plugins")
    assert code == 0
    broken = [line for line in out.splitlines() if line.startswith("broken")]
    assert len(broken) == len(WRONG) - 1  # the first of the two equal types is no mistake yet
    _check("broken_plugins", "\n".join(broken) + "\n")


@pytest.mark.usefixtures("installed")
def test_a_run_that_does_not_use_them_goes_on(rig: Path, command: Any) -> None:
    (rig.parent / "1.csv").write_text("2.0")
    out = rig.parent / "o.npz"
    code, _, err = command("detect", rig, rig.parent, "--out", out, "--quiet", "--jobs", "1")
    assert (code, err) == (0, "")
    assert out.exists()


@pytest.mark.usefixtures("installed")
def test_a_frame_that_a_plugin_fails_on_is_lost_and_named(rig: Path, command: Any) -> None:
    contents = ["2.0", "2.1", "damaged", "4x", "leave", "raise", "exit", "None", "nan", "flat"]
    for number, text in enumerate(contents):
        (rig.parent / f"{number}.csv").write_text(text)
    out = rig.parent / "o.npz"
    code, text, err = command("detect", rig, rig.parent, "--out", out, "--jobs", "1")
    assert (code, err) == (0, "")
    lost = [line for line in text.splitlines() if line.startswith("bow:")]
    _check("frames_lost", "\n".join(lost) + "\n")


@pytest.mark.usefixtures("installed")
def test_a_plugin_that_fails_on_every_frame_is_named(rig: Path, command: Any) -> None:
    for number in range(3):
        (rig.parent / f"{number}.csv").write_text("4x")
    out = rig.parent / "o.npz"
    code, _, err = command("detect", rig, rig.parent, "--out", out, "--jobs", "1", "--quiet")
    assert code == 2
    assert not out.exists()
    _check("every_frame_lost", err)
