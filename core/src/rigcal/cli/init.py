"""`rigcal init`: a first rig file from a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigcal.cli.output import Json, Quiet, print_json, print_line


def init(
    recording: Annotated[
        Path, typer.Argument(metavar="RECORDING", help="Bag or MCAP with the sensors' topics.")
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FILE", help="The rig file to be written.")
    ] = Path("rig.yaml"),
    sources: Annotated[
        list[str] | None,
        typer.Option(
            "--from",
            metavar="[SENSOR=]FILE",
            help="Lens or poses from a URDF, camchain, CameraInfo YAML or OpenCV YAML; repeatable.",
        ),
    ] = None,
    root: Annotated[
        str | None,
        typer.Option("--root", metavar="SENSOR", help="Sensor that the others hang from."),
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Write a rig file from a recording's topics, CameraInfo, /tf_static and other tools' files."""
    from rigcal.errors import InputError
    from rigcal.files import write_text
    from rigcal.plugin.registry import Registry
    from rigcal.proposal import propose_rig
    from rigcal.rig import load_rig

    if out.exists():
        raise InputError(f"{out} is there already; give another file with --out, or remove it")
    registry = Registry.from_entry_points()
    files = [_file(source) for source in sources or ()]
    write_text(out, propose_rig(recording, registry, files, root, out.name))
    rig = load_rig(out, registry)
    if json:
        print_json({"rig": str(out), "root": rig.root, "sensors": list(rig.sensors)})
    elif not quiet:
        print_line(f"{out}: {', '.join(rig.sensors)} (root {rig.root})")
        print_line("Edit it where it says FILL IN: the target, at least.")


def _file(source: str) -> tuple[Path, str | None]:
    from rigcal.errors import InputError

    name, equals, path = source.partition("=")
    if equals and not path:
        raise InputError(f"--from {source}: expected a file after the '='")
    if equals and not Path(source).exists():
        return Path(path), name
    return Path(source), None
