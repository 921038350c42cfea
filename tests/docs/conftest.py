"""Runs the code blocks of a page as its reader would: files, commands and Python, in order."""

from __future__ import annotations

import re
import runpy
import shlex
import sys
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml

from rigcal.cli import main

ROOT = Path(__file__).parents[2]
_FENCE = re.compile(r"^( *)```(\w*)(?: title=\"([^\"]+)\")?\n(.*?)^\1```$", re.M | re.S)


@dataclass(frozen=True)
class Block:
    """A fenced code block: what it is, the file that it belongs to, if any, and its text."""

    language: str
    title: str
    text: str
    where: str


def blocks_of(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    found = []
    for match in _FENCE.finditer(text):
        indent, language, title, body = match.groups()
        body = "\n".join(line.removeprefix(indent) for line in body.split("\n"))
        line = text.count("\n", 0, match.start()) + 1
        found.append(Block(language, title or "", body, f"{page.name}:{line}"))
    return found


class Desk:
    """A folder, the names of the Python blocks run so far, and what was printed."""

    def __init__(
        self,
        folder: Path,
        capsys: pytest.CaptureFixture[str],
        lay_out: Callable[[Path], Path],
    ) -> None:
        self.folder, self._capsys, self._lay_out = folder, capsys, lay_out
        self.names: dict[str, Any] = {"__name__": "__page__"}
        self.printed = ""

    def follow(self, page: Path) -> Desk:
        """Do what the page says."""
        for block in blocks_of(page):
            if block.title:
                self._write(block)
            elif block.language == "python":
                exec(compile(block.text, block.where, "exec", dont_inherit=True), self.names)
                self.printed += self._capsys.readouterr().out
            elif block.language == "bash":
                for line in block.text.replace("\\\n", " ").splitlines():
                    self.run(line.partition(" #")[0].strip(), block.where)
            elif block.language == "yaml":
                yaml.safe_load(block.text)
            elif block.language == "toml":
                tomllib.loads(block.text)
            else:
                assert block.language == "text", f"{block.where}: '{block.language}'"
                assert "rigcal " not in block.text, f"{block.where}: a command that is not run"
        return self

    def write(self, page: Path) -> None:
        """Only make the files of the page."""
        for block in blocks_of(page):
            if block.title:
                self._write(block)

    def _write(self, block: Block) -> None:
        if block.language == "python":
            compile(block.text, block.where, "exec")
        path = self.folder / block.title
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(block.text, encoding="utf-8")

    def run(self, line: str, where: str = "") -> None:
        """A line of a shell; what is printed is added to `printed`."""
        match shlex.split(line):
            case []:
                return
            case ["pip", "install", *folders]:
                for folder in folders:
                    if folder == "-e":
                        continue
                    self.install(self.folder / folder.partition("[")[0])
            case ["pytest", _]:
                pass  # of a new plugin: tests/core/skeleton does it
            case ["rigcal", "view", *_]:
                pass  # needs rerun: tests/system does it
            case ["rigcal", *arguments]:
                with pytest.raises(SystemExit) as caught:
                    main(arguments)
                output = self._capsys.readouterr()
                assert caught.value.code == 0, f"{where}: {line}\n{output.err}"
                self.printed += output.out
            case ["python", script, *arguments]:
                with pytest.MonkeyPatch.context() as patch:
                    patch.setattr(sys, "argv", [script, *arguments])
                    runpy.run_path(str(self.folder / script), run_name="__main__")
                self.printed += self._capsys.readouterr().out
            case _:
                raise AssertionError(f"{where}: cannot run {line!r}")

    def install(self, project: Path) -> None:
        """What `pip install --editable` does, but for dependencies."""
        sys.path.insert(0, str(self._lay_out(project)))


@pytest.fixture
def desk(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    lay_out: Callable[[Path], Path],
) -> Iterator[Desk]:
    """An empty folder to follow a page in; what it installs is gone afterwards."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    # Small work is done sooner without other processes.
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    yield Desk(tmp_path, capsys, lay_out)
    for name, module in list(sys.modules.items()):
        if str(getattr(module, "__file__", "")).startswith(str(tmp_path)):
            del sys.modules[name]


@pytest.fixture(scope="session")
def page() -> Callable[[str], Path]:
    return lambda name: ROOT / "docs" / name
