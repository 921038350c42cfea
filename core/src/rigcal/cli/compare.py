"""`rigcal compare`: which sensor moved."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigcal.cli.output import Json, Quiet, print_json, print_line, print_table

if TYPE_CHECKING:
    from rigcal.calibration import Calibration
    from rigcal.comparison import Comparison


def compare(
    before: Annotated[
        Path, typer.Argument(metavar="A", help="calibration.yaml, or a rig file with poses.")
    ],
    after: Annotated[Path, typer.Argument(metavar="B", help="The same of a later time.")],
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Tell which sensor moved between two calibrations.

    Exit status: 0 none moved, 1 one did or is missing from B, 2 the files cannot be compared.
    """
    from rigcal.comparison import compare as compare_all
    from rigcal.errors import InputError

    comparison = compare_all(load_poses(before), load_poses(after))
    if json:
        print_json(_as_mapping(comparison))
    elif not quiet:
        _show(comparison)
    unjudged = [name for name, change in comparison.sensors.items() if change.sigmas is None]
    if unjudged:
        raise InputError(
            f"{before} and {after}: neither has a covariance of {', '.join(unjudged)}, by which a "
            "motion could be told from noise; compare with a file that `rigcal calibrate` wrote"
        )
    if comparison.moved or comparison.only_before:
        raise typer.Exit(1)


def load_poses(path: Path) -> Calibration:
    """A calibration, or the poses of a rig."""
    from rigcal.calibration_file import load_calibration
    from rigcal.calibration_text import FORMAT
    from rigcal.comparison import calibration_of_poses
    from rigcal.document import describe, read_document
    from rigcal.errors import ConfigError
    from rigcal.plugin.registry import Registry
    from rigcal.rig import load_rig

    document = read_document(path, "a calibration or a rig")
    found = document.data.get("format")
    if found not in (None, FORMAT):
        raise ConfigError(
            f"{document.where(('format',))}: found {describe(found)}, expected '{FORMAT}', which "
            "is the calibration.yaml that `rigcal calibrate` writes, or a rig file with poses"
        )
    if found == FORMAT or "version" not in document.data:
        return load_calibration(path)
    return calibration_of_poses(load_rig(path, Registry.from_entry_points()))


def _show(comparison: Comparison) -> None:
    rows = []
    for name, change in comparison.sensors.items():
        x, y, z = (f"{round(value * 1e3, 2) + 0.0:.2f}" for value in change.T_before_after[:3, 3])
        rows.append(
            (
                name,
                f"{change.translation_m * 1e3:.2f}",
                f"{x}  {y}  {z}",
                f"{math.degrees(change.rotation_rad):.4f}",
                "-" if change.sigmas is None else f"{change.sigmas:.2f}",
                "moved" if change.moved else "",
            )
        )
    columns = ("<sensor", "mm", "x y z mm", "deg", "sigmas", "<")
    print_table(f"Change of each sensor as seen from {comparison.reference}", columns, rows)
    for where, names in (("B", comparison.only_before), ("A", comparison.only_after)):
        if names:
            print_line(f"not in {where}: {', '.join(names)}")
    print_line(f"Moved: {', '.join(comparison.moved) or 'none'}")


def _as_mapping(comparison: Comparison) -> dict[str, Any]:
    return {
        "reference": comparison.reference,
        "moved": list(comparison.moved),
        "sensors": {
            name: {
                "moved": change.moved,
                "sigmas": change.sigmas,
                "translation_mm": change.translation_m * 1e3,
                "translation_xyz_mm": (change.T_before_after[:3, 3] * 1e3).tolist(),
                "rotation_deg": math.degrees(change.rotation_rad),
            }
            for name, change in comparison.sensors.items()
        },
        "only_before": list(comparison.only_before),
        "only_after": list(comparison.only_after),
    }
