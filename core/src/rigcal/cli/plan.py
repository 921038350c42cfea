"""`rigcal plan`: what to expect of so many exposures, and where to show the board next."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigcal.cli.detect import RigFile
from rigcal.cli.output import Json, Quiet, print_json, print_line, print_table
from rigcal.cli.progress import progress_bar

if TYPE_CHECKING:
    from rigcal.planning import Plan, Sigma
    from rigcal.planning.result import Sigmas


def plan(
    rig_file: RigFile,
    observations: Annotated[
        Path | None,
        typer.Option(
            "--observations",
            metavar="FILE",
            help="What was recorded so far (observations.npz): five board poses to record next.",
        ),
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option(
            "--calibration",
            metavar="FILE",
            help="calibration.yaml with the poses; default: `pose` in the rig file.",
        ),
    ] = None,
    poses: Annotated[
        list[int] | None,
        typer.Option(
            "--poses",
            min=1,
            metavar="N",
            help="Number of exposures to predict for, also several times; "
            "default: 10, 20, 40 and 80.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="FILE", help="Picture of the rig and the board (.png or .svg)."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random numbers.")] = 0,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Predict the uncertainty of a recording, or propose what to record next."""
    from rigcal.calibration_file import load_calibration
    from rigcal.errors import InputError
    from rigcal.observation_file import load_observations
    from rigcal.planning import EXPOSURES
    from rigcal.planning import plan as plan_all
    from rigcal.plugin.registry import Registry
    from rigcal.report import check_picture, write_plan_picture
    from rigcal.rig import load_rig

    if poses and observations:
        raise InputError(
            "--poses predicts for recordings that are yet to be made; leave it out, or "
            "--observations"
        )
    if out is not None:
        check_picture(out)
    registry = Registry.from_entry_points()
    rig = load_rig(rig_file, registry)
    recorded = None if observations is None else load_observations(observations)[0]
    known = None if calibration is None else load_calibration(calibration)
    exposures = sorted(set(poses or EXPOSURES))
    with progress_bar(quiet or json) as progress:
        result = plan_all(rig, registry, recorded, known, exposures, seed, progress)
    if out is not None:
        write_plan_picture(out, result, rig, registry)
    if json:
        print_json(_as_mapping(result) | ({"picture": str(out)} if out else {}))
    elif not quiet:
        _show(result)
        if out is not None:
            print_line(f"picture  {out}")


def _show(plan: Plan) -> None:
    for sensor in plan.unjoined:
        print_line(f"{sensor} is not joined to the others by what was recorded.")
    for sensor, why in plan.unplanned.items():
        print_line(f"{sensor} is not planned for: {why}.")
    if plan.recorded is None:
        columns = [f"{n} exposure{'s' * (n > 1)}" for n in plan.predicted]
        _show_sigmas(
            f"Predicted sigma (mm, deg) as seen from {plan.reference}, with board poses spread "
            "over the views of all sensors",
            columns,
            list(plan.predicted.values()),
        )
        return
    _show_sigmas(
        f"Sigma (mm, deg) as seen from {plan.reference}",
        ["recorded", f"with the {len(plan.proposals)} poses below"],
        [plan.recorded, plan.after or {}],
    )
    _show_proposals(plan)


def _show_sigmas(title: str, columns: Sequence[str], sigmas: Sequence[Sigmas]) -> None:
    rows = [(name, *(_cell(own[name]) for own in sigmas)) for name in sigmas[0]]
    print_table(title, ("<sensor", *columns), rows)


def _show_proposals(plan: Plan) -> None:
    from rigcal.planning.result import worst
    from rigcal.planning.words import LEGEND

    print_line("Show the board next:")
    for number, proposal in enumerate(plan.proposals, start=1):
        # What no pose is planned for stays as open as it is.
        name = worst({s: v for s, v in proposal.sigmas.items() if s not in plan.unplanned})
        print_line(f"{number}. {proposal.words}")
        print_line(
            f"   seen by {', '.join(proposal.seen_by)}; the worst is then {name}: "
            f"{_cell(proposal.sigmas[name])}"
        )
    print_line(LEGEND)


def _cell(sigma: Sigma) -> str:
    """`0.28 mm, 0.015 deg`; `open` if neither is determined."""
    from rigcal.report.tables import spread

    mm, deg = 1e3 * sigma.translation_m, math.degrees(sigma.rotation_rad)
    if not math.isfinite(mm) and not math.isfinite(deg):
        return "open"
    return ", ".join(
        f"{spread(value)} {unit}" if math.isfinite(value) else f"open ({unit})"
        for value, unit in ((mm, "mm"), (deg, "deg"))
    )


def _as_mapping(plan: Plan) -> dict[str, Any]:
    return {
        "reference": plan.reference,
        "predicted": {str(n): _numbers(own) for n, own in plan.predicted.items()},
        "recorded": None if plan.recorded is None else _numbers(plan.recorded),
        "proposals": [
            {
                "words": p.words,
                "target": p.target,
                "seen_by": list(p.seen_by),
                "T_root_target": p.T_root_t.tolist(),
                "sigmas": _numbers(p.sigmas),
            }
            for p in plan.proposals
        ],
        "unjoined": list(plan.unjoined),
        "unplanned": dict(plan.unplanned),
    }


def _numbers(sigmas: Sigmas) -> dict[str, dict[str, float]]:
    """By sensor; not finite where open."""
    return {
        name: {"mm": 1e3 * s.translation_m, "deg": math.degrees(s.rotation_rad)}
        for name, s in sigmas.items()
    }
