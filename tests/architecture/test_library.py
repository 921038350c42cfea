"""A library, not a program: only the command line prints, exits and asks."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]
PROGRAMS = ("rigcal/cli/", "rigcal_sim/commands.py", "rigcal/skeleton/template/")
FORBIDDEN = {"print", "input", "sys.exit", "exit", "quit", "os.chdir", "os._exit", "signal.signal"}


def _library() -> list[Path]:
    sources = [*ROOT.glob("core/src/**/*.py"), *ROOT.glob("plugins/*/src/**/*.py")]
    return [p for p in sources if not any(part in p.as_posix() for part in PROGRAMS)]


def test_no_library_function_prints_exits_or_changes_the_process() -> None:
    for path in _library():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            where = f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 0)}"
            if isinstance(node, ast.Call):
                assert ast.unparse(node.func) not in FORBIDDEN, where
            assert not isinstance(node, ast.Global), where


def test_messages_go_to_loggers_below_rigcal() -> None:
    for path in _library():
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "logging.getLogger":
                (name,) = map(ast.unparse, node.args)
                assert name == "__name__" or name.strip("'").startswith("rigcal"), path
            if isinstance(node, ast.Call):
                assert ast.unparse(node.func) not in {"logging.basicConfig", "logging.warning"}
