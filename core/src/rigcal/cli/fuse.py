"""`rigcal fuse`: what all sensors saw at one moment, in one cloud."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigcal.cli.output import Json, Quiet, print_json, print_line
from rigcal.cli.progress import progress_bar

Recorded = Annotated[Path, typer.Argument(metavar="RECORDING", help="A bag, or a folder of files.")]
Calibrated = Annotated[
    Path, typer.Argument(metavar="CALIBRATION", help="calibration.yaml of the rig.")
]
RigOption = Annotated[
    Path, typer.Option("--rig", metavar="RIG", help="The rig file: topics and lenses.")
]


def fuse(
    recording: Recorded,
    calibration: Calibrated,
    rig_file: RigOption,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for the cloud and pictures.")
    ],
    frame: Annotated[
        int | None,
        typer.Option(
            min=0, metavar="N", help="Number of the 3D laser's frame; default: the middle one."
        ),
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Colour the cloud by the cameras, put the scans in place, lay it over the images."""
    from rigcal.calibration_file import load_calibration
    from rigcal.fusing import fuse as fuse_moment
    from rigcal.fusing import write_fused
    from rigcal.plugin.registry import Registry
    from rigcal.rig import load_rig

    registry = Registry.from_entry_points()
    rig = load_rig(rig_file, registry)
    with progress_bar(quiet or json) as progress:
        progress("fusing", 0, 1)
        fused = fuse_moment(rig, registry, recording, load_calibration(calibration), frame)
        files = write_fused(out, fused)
        progress("fusing", 1, 1)
    coloured = int((fused.camera >= 0).sum())
    if json:
        print_json(
            {
                "files": {what: str(path) for what, path in files.items()},
                "points": len(fused.points),
                "coloured": coloured,
                "lag_s": dict(fused.lag_s),
            }
        )
    elif not quiet:
        print_line(f"{len(fused.points)} points, {coloured} coloured, from {fused.leader}'s frame")
        for name, lag in fused.lag_s.items():
            if name != fused.leader and lag:
                print_line(
                    f"  {name}: taken {abs(1e3 * lag):.1f} ms {'later' if lag > 0 else 'earlier'}"
                )
        for what, path in files.items():
            print_line(f"{what:16} {path}")
