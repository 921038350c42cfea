"""Error messages as a user reads them, word for word.

After a deliberate change: RIGCAL_UPDATE_GOLDEN=1 pytest tests/golden, then read the difference.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import pytest
from pydantic import Field

from rigcal.observation import Detection
from rigcal.plugin import SensorConfig, SensorType, hookimpl

HERE = Path(__file__).parent


class SonarConfig(SensorConfig, frozen=True):
    type: Literal["sonar"] = "sonar"
    range_max_m: float = Field(gt=0)


def _decode(message: object, config: object) -> object:
    return message


def _detect(frame: object, config: object, target: object) -> Detection:
    return Detection((), "deaf")


class Sonar:
    @hookimpl
    def rigcal_sensor_types(self) -> list[SensorType]:
        return [SensorType("sonar", SonarConfig, (".csv",), _decode, _detect)]


class Misspelt:
    @hookimpl
    def rigcal_sensor_typs(self) -> list[SensorType]:
        return []


def _missing() -> object:
    raise ModuleNotFoundError("No module named 'libradar'")


def _entry(name: str, load: Callable[[], object]) -> Any:
    return SimpleNamespace(
        name=name, load=load, dist=SimpleNamespace(name=f"acme-{name}", version="2.0")
    )


def _install(monkeypatch: pytest.MonkeyPatch, *entries: Any) -> None:
    installed = [_entry("sonar", Sonar), *entries]
    monkeypatch.setattr("rigcal.plugin.registry.entry_points", lambda group: installed)


def _check(name: str, text: str) -> None:
    path = HERE / "messages" / f"{name}.txt"
    if "RIGCAL_UPDATE_GOLDEN" in os.environ:
        path.write_text(text)
    assert text == path.read_text()


def _refused(command: Any, *arguments: str) -> str:
    code, out, err = command(*arguments)
    assert (code, out) == (2, "")
    return str(err)


@pytest.mark.parametrize("rig", sorted((HERE / "rigs").glob("*.yaml")), ids=lambda p: p.stem)
def test_rig_that_is_wrong(
    rig: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: Any,
) -> None:
    _install(monkeypatch)
    monkeypatch.chdir(rig.parent)
    _check(rig.stem, _refused(command, "detect", rig.name, "bag", "--out", str(tmp_path / "o.npz")))
    assert not list(tmp_path.iterdir())


def test_rig_that_needs_a_broken_plugin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: Any
) -> None:
    _install(monkeypatch, _entry("radar", _missing))
    monkeypatch.chdir(HERE / "rigs")
    text = _refused(command, "calibrate", "unknown_sensor_type.yaml", "bag", "--out", str(tmp_path))
    _check("broken_plugin", text)


def test_list_of_plugins_tells_what_is_broken(
    monkeypatch: pytest.MonkeyPatch, command: Any
) -> None:
    _install(monkeypatch, _entry("radar", _missing), _entry("lidar", Misspelt))
    ran = command("plugins")
    assert ran.code == 0
    broken = [line for line in ran.out.splitlines() if line.startswith("broken")]
    _check("list_of_broken_plugins", "\n".join(broken) + "\n")
