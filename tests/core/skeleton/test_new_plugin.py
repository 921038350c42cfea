"""A new plugin works before its author has changed anything."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import rigcal
from rigcal.errors import InputError


def test_its_tests_pass_as_written(
    tmp_path: Path, lay_out: Callable[[Path], Any], own_tests: Any
) -> None:
    folder = rigcal.new_plugin("side-scan", tmp_path / "rigcal-side-scan")
    lay_out(folder)
    done = own_tests(folder)
    assert done.returncode == 0, done.stdout
    assert re.search(r"\d\d passed, 1 deselected", done.stdout)


def test_no_word_of_the_template_is_left(tmp_path: Path) -> None:
    folder = rigcal.new_plugin("side-scan", tmp_path / "new" / "rigcal-side-scan")
    for path in folder.rglob("*"):
        assert "skeleton" not in path.name
        if path.is_file():
            assert "skeleton" not in path.read_text().lower(), path
    assert {p.relative_to(folder).as_posix() for p in folder.rglob("*.py")} == {
        "tests/test_side_scan.py",
        *(
            f"src/rigcal_side_scan/{name}.py"
            for name in ("__init__", "config", "detector", "messages", "simulator")
        ),
    }
    assert [p.name for p in folder.parent.iterdir()] == ["rigcal-side-scan"]


def test_readme_names_every_file(tmp_path: Path) -> None:
    folder = rigcal.new_plugin("sonar", tmp_path / "rigcal-sonar")
    named = set(re.findall(r"`((?:src|tests)/\S+)`", (folder / "README.md").read_text()))
    assert named == {p.relative_to(folder).as_posix() for p in folder.rglob("*.py")}


@pytest.mark.parametrize("name", ["Sonar", "2d", "side scan", "", "sonar-", "../sonar"])
def test_bad_name_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="use small letters and digits"):
        rigcal.new_plugin(name, tmp_path / "new")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("name", ["rigcal-side-scan", "rigcal_side-scan"])
def test_name_of_the_distribution_is_told_from_that_of_the_type(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=f"'{name}' is the name of a distribution.*: 'side-scan'$"):
        rigcal.new_plugin(name, tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_a_name_is_suggested_only_if_it_can_be_one(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="'rigcal-' is no name for a sensor type: use small"):
        rigcal.new_plugin("rigcal-", tmp_path / "new")


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("work of years")
    with pytest.raises(InputError, match="is there already"):
        rigcal.new_plugin("sonar", tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["mine.py"]


def test_place_that_cannot_be_written_to_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(InputError, match=r"file/new: cannot be written: (Not a dir|File exists)"):
        rigcal.new_plugin("sonar", tmp_path / "file" / "new")


def test_command_tells_what_to_do_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    ran = command("new-plugin", "sonar")
    assert ran.code == 0
    assert "pip install -e 'rigcal-sonar[test]' && pytest rigcal-sonar" in ran.out
    assert (tmp_path / "rigcal-sonar" / "README.md").is_file()
    ran = command("new-plugin", "sonar", "--out", "a", "--json")
    assert (ran.code, json.loads(ran.out)) == (0, {"folder": "a"})
    assert command("new-plugin", "sonar", "--out", "b", "--quiet") == (0, "", "")


def test_name_of_an_installed_type_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: Any
) -> None:
    registry = rigcal.Registry()
    monkeypatch.setattr(type(registry), "sensor_types", {"sonar": None})
    ran = command("new-plugin", "sonar", "--out", tmp_path / "new")
    assert ran.code == 2
    assert "sensor type 'sonar' is installed already" in ran.err
