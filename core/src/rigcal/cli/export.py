"""`rigcal export`: a calibration for other tools."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigcal.cli.output import Json, Quiet, print_json, print_line


def export(
    calibration: Annotated[
        Path, typer.Argument(metavar="CALIBRATION", help="calibration.yaml to be exported.")
    ],
    form: Annotated[
        str,
        typer.Option("--format", "-f", metavar="NAME", help="One of those `rigcal plugins` lists."),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", metavar="FILE", help="The file, or a folder if the format has several."
        ),
    ],
    rig_file: Annotated[
        Path | None,
        typer.Option(
            "--rig",
            metavar="RIG",
            help="The rig file, for formats that hold more than poses: lenses, topics, frames.",
        ),
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Write a calibration in the file format of another tool."""
    from rigcal.calibration_file import load_calibration
    from rigcal.exporting import write_export
    from rigcal.plugin.registry import Registry
    from rigcal.rig import load_rig

    registry = Registry.from_entry_points()
    exporter = registry.exporter(form)
    rig = load_rig(rig_file, registry) if rig_file else None
    files = write_export(out, load_calibration(calibration), registry, form, rig)
    if json:
        print_json({"format": form, "files": [str(path) for path in files]})
    elif not quiet:
        for path in files:
            print_line(f"{path}: {exporter.summary}")
