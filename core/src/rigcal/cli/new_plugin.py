"""`rigcal new-plugin`: a plugin for a new sensor type, written out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigcal.cli.output import Json, Quiet, print_json, print_line


def new_plugin(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="What rig files will say after `type:`.")
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="DIR", help="Its folder; default: ./rigcal-NAME."),
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Write a plugin for a new sensor type: code that works, tests, and what to change where."""
    from rigcal.errors import InputError
    from rigcal.plugin.registry import Registry
    from rigcal.skeleton import new_plugin as write

    registry = Registry.from_entry_points()
    if name in registry.sensor_types:
        raise InputError(f"sensor type '{name}' is installed already; take another name")
    folder = write(name, out)
    if json:
        print_json({"folder": str(folder)})
    elif not quiet:
        print_line(f"{folder / 'README.md'} says what to write where. It works as it is:")
        print_line(f"    pip install -e '{folder}[test]' && pytest {folder}")
