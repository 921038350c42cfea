"""`rigcal evaluate`: a calibration against the truth."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigcal.cli.output import Json, print_json, print_line, print_table

if TYPE_CHECKING:
    from rigcal.evaluation import Evaluation


def evaluate(
    calibration: Annotated[
        Path, typer.Argument(metavar="CALIBRATION", help="calibration.yaml to be judged.")
    ],
    truth: Annotated[Path, typer.Option(metavar="FILE", help="truth.yaml to compare with.")],
    json: Json = False,
) -> None:
    """Compare a calibration with the truth."""
    from rigcal.calibration_file import load_calibration
    from rigcal.evaluation import evaluate as compare

    evaluation = compare(load_calibration(calibration), load_calibration(truth))
    if json:
        print_json(_as_mapping(evaluation))
    else:
        show(evaluation)


def show(evaluation: Evaluation) -> None:
    """Print an evaluation as a table."""
    from rigcal.cli.result_tables import print_graph_error

    rows = [
        (
            name,
            f"{e.translation_m * 1e3:.3f}",
            f"{math.degrees(e.rotation_rad):.4f}",
            f"{math.degrees(e.axis_rad):.4f}",
            "-" if e.sigmas is None else f"{e.sigmas:.2f}",
        )
        for name, e in evaluation.sensors.items()
    ]
    means = (evaluation.mean_translation_m, evaluation.mean_rotation_rad, evaluation.mean_axis_rad)
    squares = (evaluation.rms_translation_m, evaluation.rms_rotation_rad, evaluation.rms_axis_rad)
    for label, (metres, *radians) in (("mean", means), ("rms", squares)):
        whole, axis = (f"{math.degrees(angle):.4f}" for angle in radians)
        rows.append((label, f"{metres * 1e3:.3f}", whole, axis, ""))
    title = f"Error of each sensor in the frame of {evaluation.root}"
    print_table(title, ("<sensor", "mm", "deg", "z axis deg", "sigmas"), rows)
    print_graph_error(evaluation.graph_error)
    for where, names in (
        ("truth", evaluation.only_in_calibration),
        ("calibration", evaluation.only_in_truth),
    ):
        if names:
            print_line(f"not in the {where}: {', '.join(names)}")


def _as_mapping(evaluation: Evaluation) -> dict[str, Any]:
    return {
        "root": evaluation.root,
        "sensors": {
            name: {
                "translation_mm": e.translation_m * 1e3,
                "rotation_deg": math.degrees(e.rotation_rad),
                "axis_deg": math.degrees(e.axis_rad),
                "nees": e.nees,
            }
            for name, e in evaluation.sensors.items()
        },
        "mean_translation_mm": evaluation.mean_translation_m * 1e3,
        "mean_rotation_deg": math.degrees(evaluation.mean_rotation_rad),
        "mean_axis_deg": math.degrees(evaluation.mean_axis_rad),
        "rms_translation_mm": evaluation.rms_translation_m * 1e3,
        "rms_rotation_deg": math.degrees(evaluation.rms_rotation_rad),
        "rms_axis_deg": math.degrees(evaluation.rms_axis_rad),
        "graph_error": evaluation.graph_error and vars(evaluation.graph_error),
        "only_in_calibration": list(evaluation.only_in_calibration),
        "only_in_truth": list(evaluation.only_in_truth),
    }
