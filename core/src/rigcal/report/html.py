"""Assembly of the report: tables and figures put into one HTML page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rigcal.calibration import Calibration
from rigcal.files import write_text
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.observation import Observation
from rigcal.plugin.registry import Registry
from rigcal.report import tables
from rigcal.rig import Rig, build_targets


def write_report(
    path: Path | str,
    calibration: Calibration,
    observations: Sequence[Observation],
    rig: Rig,
    registry: Registry,
) -> None:
    """Write the report of a calibration as one self-contained HTML file.

    `observations` are those that the calibration was made from. The same input gives the same
    bytes. The file appears whole or not at all; InputError when it cannot be written.
    """
    write_text(path, render(calibration, observations, rig, registry))


def render(
    calibration: Calibration, observations: Sequence[Observation], rig: Rig, registry: Registry
) -> str:
    """The report's HTML text."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("rigcal.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = environment.get_template("report.html")
    return page.render(_context(calibration, observations, rig, registry))


def _context(
    calibration: Calibration, observations: Sequence[Observation], rig: Rig, registry: Registry
) -> dict[str, Any]:
    from markupsafe import Markup

    from rigcal.report import figures

    sensors = {name: calibration.T(calibration.root, name) for name in calibration.sensors}
    boards = _boards(calibration, observations, rig, registry)
    return {
        "title": f"Calibration of {rig.name}",
        "headline": tables.headline(calibration),
        "warnings": calibration.warnings,
        "root": calibration.root,
        "sensors": list(calibration.sensors),
        "transforms": tables.transform_rows(calibration),
        "residuals": tables.residual_rows(calibration),
        "refined": tables.refined_rows(calibration),
        "exposures": tables.exposure_rows(calibration, observations),
        "rejections": tables.rejections(calibration, observations),
        "provenance": tables.provenance_rows(calibration.provenance),
        # The figures are the only text that is not escaped: matplotlib escapes what it draws.
        "rig_figure": Markup(figures.rig_figure(sensors)),
        "boards_figure": Markup(figures.boards_figure(sensors, boards)) if boards else None,
    }


def _boards(
    calibration: Calibration, observations: Sequence[Observation], rig: Rig, registry: Registry
) -> list[Array]:
    """The outline of the target (K, 3) in the root's frame, per exposure of the solution."""
    targets = build_targets(rig, registry)
    shown = {o.exposure: rig.target_of(o.sensor) for o in observations if o.candidates}
    first = next(iter(targets))
    return [
        se3.apply(T_root_t, targets[shown.get(exposure, first)].outline_points)
        for exposure, T_root_t in calibration.target_poses.items()
    ]
