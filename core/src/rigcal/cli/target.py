"""`rigcal target`: the board as a page to print."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigcal.cli.detect import RigFile
from rigcal.cli.output import Json, Quiet, print_json, print_line


def target(
    rig_file: RigFile,
    out: Annotated[
        Path,
        typer.Option("--out", "-o", metavar="FILE", help="The page: .pdf, .ps, .svg or .png."),
    ],
    name: Annotated[
        str | None,
        typer.Option("--target", metavar="NAME", help="Which target, if the rig has several."),
    ] = None,
    px_per_mm: Annotated[int, typer.Option(min=1, help="Resolution of a PNG.")] = 4,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Write the printable page of a target, at true scale.

    The page is as large as the board and its margins, with cut marks at the board's corners, a
    100 mm ruler to check the print, and the target's definition to paste in a rig file. Print it
    at 100 %, not fitted to the paper; a print shop makes any size.
    """
    from rigcal.plugin.registry import Registry
    from rigcal.printing import write_target_page
    from rigcal.rig import load_targets

    targets = load_targets(rig_file, Registry.from_entry_points())
    name = _chosen(rig_file, list(targets), name)
    board = targets[name]
    page = write_target_page(out, board, px_per_mm)
    board_mm = [round(1e3 * float(side), 3) for side in board.size]
    if json:
        print_json(
            {"page": str(out), "target": name, "board_mm": board_mm, "page_mm": page.size_mm}
        )
    elif not quiet:
        sizes = [" x ".join(f"{side:g}" for side in size) for size in (board_mm, page.size_mm)]
        print_line(f"{out}: '{name}' of {sizes[0]} mm on a page of {sizes[1]} mm; print at 100 %")


def _chosen(rig_file: Path, names: list[str], name: str | None) -> str:
    from rigcal.errors import ConfigError, InputError
    from rigcal.validation import nearest_of

    if name is None and len(names) > 1:
        raise InputError(
            f"{rig_file} has several targets; add `--target NAME`, one of {', '.join(names)}"
        )
    if name is not None and name not in names:
        raise ConfigError(f"{rig_file}: targets: no target '{name}'{nearest_of(name, names)}")
    return name or names[0]
