"""`rigcal validate`: does the result hold for exposures that it has not seen?"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigcal.cli.detect import RigFile
from rigcal.cli.output import Jobs, Json, Quiet, print_json, print_line, print_table
from rigcal.cli.progress import progress_bar

if TYPE_CHECKING:
    from rigcal.resampling import Bootstrap, CrossValidation

# Of 100 draws the scatter is known to a tenth.
_WIDE = 2.0


def validate(
    rig_file: RigFile,
    data: Annotated[
        Path,
        typer.Argument(metavar="DATA", help="A recording, or observations.npz made by `detect`."),
    ],
    folds: Annotated[
        int, typer.Option(min=2, help="Parts of the exposures, each held out in turn.")
    ] = 5,
    draws: Annotated[
        int,
        typer.Option(
            "--bootstrap", min=0, metavar="N", help="Draw the exposures anew as often; 0: not."
        ),
    ] = 0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of folds, draws and sampling.")] = 0,
    jobs: Jobs = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Hold exposures out and see how well the others' calibration explains them."""
    from rigcal.detection import detect
    from rigcal.observation_file import load_observations
    from rigcal.plugin.registry import Registry
    from rigcal.resampling import bootstrap, cross_validate
    from rigcal.rig import load_rig

    registry = Registry.from_entry_points()
    rig = load_rig(rig_file, registry)
    with progress_bar(quiet or json) as progress:
        if data.suffix == ".npz":
            observations, _ = load_observations(data)
        else:
            observations = detect(rig, registry, data, progress, jobs)
        folded = cross_validate(rig, registry, observations, folds, seed, progress)
        drawn = bootstrap(rig, registry, observations, draws, seed, progress) if draws else None
    if json:
        scatter = {"bootstrap": _scatter_mapping(drawn)} if drawn else {}
        print_json({**_folds_mapping(folded), **scatter})
    elif not quiet:
        _show_folds(folded)
        if drawn:
            _show_scatter(drawn)


def _show_folds(result: CrossValidation) -> None:
    rows = [
        (name, f"{_shown(s.fitted_rms, s.unit)}", f"{_shown(s.held_out_rms, s.unit)}", str(s.count))
        for name, s in result.sensors.items()
    ]
    title = f"Rms errors of the same exposures, fitted and held out in {len(result.folds)} folds"
    print_table(title, ("<sensor", "fitted", "held out", "values"), rows)
    excess, expected, by_chance, limit = (
        f"{100 * share:.2g}"
        for share in (result.excess, result.expected, result.deviation, result.limit)
    )
    print_line(
        f"Held out, their sum of squares is {excess} % larger than fitted; expected from the "
        f"covariance: {expected} +- {by_chance} %, and more than {limit} % once in 1000 times."
    )
    for number, fold in enumerate(result.folds, start=1):
        if fold.problem:
            print_line(
                f"warning: without the {len(fold.exposures)} exposures of fold {number} "
                f"({', '.join(fold.exposures)}) there is no result: {fold.problem}"
            )
    print_line(_words(result))


def _words(result: CrossValidation) -> str:
    if result.holds:
        return "The result holds for exposures that it has not seen."
    if any(fold.problem for fold in result.folds):
        return "The result rests on single exposures: record more of the kind that is named above."
    return (
        "The result explains what it has not seen worse than its covariance says: check that the "
        "board stood still and is flat, the lens models, and what `refine` asks for."
    )


def _show_scatter(result: Bootstrap) -> None:
    rows = [
        (
            name,
            *(f"{1e3 * _size(C, slice(3, 6)):.3f}" for C in (s.reported, s.covariance)),
            *(f"{math.degrees(_size(C, slice(3))):.4f}" for C in (s.reported, s.covariance)),
        )
        for name, s in result.sensors.items()
    ]
    columns = ("<sensor", "sigma mm", "bootstrap mm", "sigma deg", "bootstrap deg")
    failed = f"; {result.failed} more had no answer" if result.failed else ""
    title = f"Reported sigma, and the scatter over {result.draws} draws of the exposures{failed}"
    print_table(title, columns, rows)
    for name, s in result.sensors.items():
        parts = slice(3), slice(3, 6)
        times = max(_size(s.covariance, part) / _size(s.reported, part) for part in parts)
        if times > _WIDE:
            print_line(
                f"warning: {name} scatters {times:.2g} times its sigma: it rests on few exposures, "
                "or measurements of an exposure err alike (a board that bends or trembles); record "
                "more"
            )


def _shown(value: float, unit: str) -> str:
    return f"{1e3 * value:.3f} mm" if unit == "m" else f"{value:.4f} {unit}"


def _size(covariance: Any, part: slice) -> float:
    """Root of the trace: the standard deviation of the vector's length."""
    return math.sqrt(covariance[part, part].trace())


def _folds_mapping(result: CrossValidation) -> dict[str, Any]:
    return {
        "holds": result.holds,
        "excess": result.excess,
        "expected": result.expected,
        "deviation": result.deviation,
        "limit": result.limit,
        "folds": [{"exposures": list(f.exposures), "problem": f.problem} for f in result.folds],
        "sensors": {name: vars(s) for name, s in result.sensors.items()},
    }


def _scatter_mapping(result: Bootstrap) -> dict[str, Any]:
    return {
        "draws": result.draws,
        "failed": result.failed,
        "sensors": {
            name: {"covariance": s.covariance.tolist(), "reported": s.reported.tolist()}
            for name, s in result.sensors.items()
        },
    }
