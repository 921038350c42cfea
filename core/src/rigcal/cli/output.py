"""Where commands write: results to stdout, as tables for people or JSON for programs."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from rigcal.errors import InputError

Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
Jobs = Annotated[
    int | None, typer.Option("--jobs", "-j", min=1, help="Processes; default: one per core.")
]


def print_json(value: Mapping[str, Any] | Sequence[Any]) -> None:
    """Print JSON; numbers that are not finite become null."""
    text = json.dumps(_finite(value), indent=2, ensure_ascii=False, allow_nan=False)
    sys.stdout.write(text + "\n")


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table; columns that start with "<" are aligned to the left."""
    from rich import box
    from rich.table import Table

    if title:
        print_line(title)
    table = Table(box=box.SIMPLE_HEAD)
    for column in columns:
        left = column.startswith("<")
        table.add_column(
            column.removeprefix("<"), justify="left" if left else "right", no_wrap=not left
        )
    for row in rows:
        table.add_row(*row)
    _console().print(table)


def print_line(text: str = "") -> None:
    """Print a line as it is."""
    _console().print(text, markup=False, highlight=False, soft_wrap=True)


def make_folder(folder: Path) -> Path:
    """The folder, made if it is missing; InputError before work is lost on one that cannot be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made a folder: {error.strerror}") from error
    return folder


def _console() -> Any:
    from rich.console import Console

    console = Console()
    # Files and pipes have no width: a table must not be cut to the 80 columns that rich assumes.
    return console if console.is_terminal else Console(width=160)


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _finite(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(inner) for inner in value]
    if isinstance(value, float) and not float("-inf") < value < float("inf"):
        return None
    return value
