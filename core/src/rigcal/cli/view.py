"""`rigcal view`: rig, boards, images, scans and clouds on one time line, in rerun."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigcal.cli.compare import load_poses
from rigcal.cli.fuse import Calibrated, Recorded, RigOption
from rigcal.cli.output import Quiet, print_line
from rigcal.cli.progress import progress_bar

if TYPE_CHECKING:
    from rigcal.observation import Observation


def view(
    recording: Recorded,
    calibration: Calibrated,
    rig_file: RigOption,
    observations: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="observations.npz; default: the one beside the calibration."
        ),
    ] = None,
    before: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Another calibration, or a rig file with poses, to lay beside it."
        ),
    ] = None,
    save: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write a file (.rrd) for the viewer, and do not open it."
        ),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Look at a calibration and its recording in 3D, exposure by exposure (needs rerun)."""
    from rigcal.calibration_file import load_calibration
    from rigcal.plugin.registry import Registry
    from rigcal.report import show_timeline, write_timeline
    from rigcal.rig import load_rig

    registry = Registry.from_entry_points()
    rig = load_rig(rig_file, registry)
    found = load_calibration(calibration)
    seen = _observations(observations or calibration.parent / "observations.npz")
    earlier = load_poses(before) if before is not None else None
    with progress_bar(quiet) as progress:
        if save is None:
            show_timeline(found, seen, rig, registry, recording, earlier, progress)
        else:
            write_timeline(save, found, seen, rig, registry, recording, earlier, progress)
    if save is not None and not quiet:
        print_line(f"time line  {save}  (look at it with: rerun {save})")


def _observations(path: Path) -> list[Observation]:
    from rigcal.errors import InputError
    from rigcal.observation_file import load_observations

    if not path.exists():
        raise InputError(
            f"{path}: no such file; give the observations that the calibration was made from by "
            "--observations (`rigcal calibrate` writes them beside it)"
        )
    return list(load_observations(path)[0])
