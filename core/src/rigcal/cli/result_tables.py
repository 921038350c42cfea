"""A calibration as tables on a terminal."""

from __future__ import annotations

from rigcal.calibration import Calibration, GraphError
from rigcal.cli.output import print_line, print_table
from rigcal.report import tables

_REASONS = 12
_EXPOSURES = 8


def print_calibration(calibration: Calibration) -> None:
    """Print where the sensors are, what they contributed, and what was left out."""
    print_line(tables.headline(calibration))
    transforms = {row.sensor: row for row in tables.transform_rows(calibration)}
    rows = []
    for seen in tables.residual_rows(calibration):
        pose = transforms.get(seen.sensor)
        where = (
            ("root", "", "")
            if pose is None
            else (
                pose.parent,
                "  ".join(pose.translation_mm),
                "  ".join(pose.rpy_deg),
            )
        )
        rows.append((seen.sensor, *where, f"{seen.used}/{seen.seen}", seen.rms))
    columns = (
        "<sensor", "<in", "x y z mm", "roll pitch yaw deg", "used/found", "residual rms",
    )  # fmt: skip
    print_table("", columns, rows)
    uncertain = tables.uncertainty_rows(calibration)
    if uncertain:
        columns = ("<sensor", "sigma mm", "as configured", "sigma deg", "as configured", "<verdict")
        print_table("", columns, [row.cells for row in uncertain])
    if calibration.verdict is not None:
        for line in calibration.verdict.lines():
            print_line(line)
    refined = tables.refined_rows(calibration)
    if refined:
        print_table("", ("<of", "<refined", "value", "sigma", "started at"), refined)
    print_graph_error(calibration.graph_error)
    _print_rejected(calibration)
    for warning in calibration.warnings:
        print_line(f"warning: {warning}")


def print_graph_error(error: GraphError | None) -> None:
    """Print the seed's metric at the pairs' tree and at the result."""
    if error is not None:
        print_line(
            f"Graph error over {error.edges} edges of MSG-Cal: {error.pairwise_m2:.6g} m^2 with "
            f"the tree of pairs, {error.solution_m2:.6g} m^2 with this result"
        )


def _print_rejected(calibration: Calibration) -> None:
    """Exposures that were left out, grouped by sensor and reason, the longest groups first."""
    groups: dict[tuple[str, str], list[str]] = {}
    for rejection in calibration.rejected:
        groups.setdefault((rejection.sensor, rejection.reason), []).append(rejection.exposure)
    ordered = sorted(groups.items(), key=lambda group: -len(group[1]))
    if ordered:
        print_line(f"Left out: {len(calibration.rejected)} observations")
    for (sensor, reason), exposures in ordered[:_REASONS]:
        names = sorted(exposures, key=tables.natural_order)
        shown = ", ".join(names[:_EXPOSURES]) + (", ..." if len(names) > _EXPOSURES else "")
        print_line(f"  {sensor}: {len(names)} ({shown}): {reason}")
    if len(ordered) > _REASONS:
        print_line(f"  ... and {len(ordered) - _REASONS} more reasons in calibration.yaml")
