"""Assembly of the report: tables, figures, pictures and the 3D view put into one HTML page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from rigcal.calibration import Calibration
from rigcal.exposures import name_in_result
from rigcal.files import write_text
from rigcal.observation import Observation
from rigcal.plugin.registry import Registry
from rigcal.progress import Progress
from rigcal.report import tables
from rigcal.report.boards import boards_in_root, sorted_exposures
from rigcal.report.pictures import Pictures, pictures
from rigcal.report.scene3d import scene3d
from rigcal.report.sensor_errors import config_of, errors_by_sensor
from rigcal.rig import Rig


def write_report(
    path: Path | str,
    calibration: Calibration,
    observations: Sequence[Observation],
    rig: Rig,
    registry: Registry,
    recording: Path | None = None,
    progress: Progress | None = None,
) -> None:
    """Write the report of a calibration as one self-contained HTML file.

    `observations` are those that the calibration was made from, `recording` what they were detected
    in: with it the report shows pictures. The same input gives the same bytes. The file appears
    whole or not at all; InputError when it cannot be written, RecordingError when the recording
    cannot be read.
    """
    write_text(path, render(calibration, observations, rig, registry, recording, progress))


def render(
    calibration: Calibration,
    observations: Sequence[Observation],
    rig: Rig,
    registry: Registry,
    recording: Path | None = None,
    progress: Progress | None = None,
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
    observations = [replace(o, exposure=name_in_result(rig, o)) for o in observations]
    shown = Pictures()
    if recording is not None:
        shown = pictures(recording, calibration, observations, rig, registry, progress)
    page = environment.get_template("report.html")
    return page.render(
        _texts(calibration, observations, rig)
        | _figures(calibration, observations, rig, registry, progress)
        | {"overlays": shown.overlays, "left_out": shown.left_out}
        | {"thumbnails": shown.thumbnails or {}, "has_pictures": recording is not None}
    )


def _texts(
    calibration: Calibration, observations: Sequence[Observation], rig: Rig
) -> dict[str, Any]:
    return {
        "title": f"Calibration of {rig.name}",
        "headline": tables.headline(calibration),
        "warnings": calibration.warnings,
        "root": calibration.root,
        "sensors": list(calibration.sensors),
        "transforms": tables.transform_rows(calibration),
        "residuals": tables.residual_rows(calibration),
        "verdict": calibration.verdict.lines() if calibration.verdict else [],
        "uncertainties": tables.uncertainty_rows(calibration),
        "refined": tables.refined_rows(calibration),
        "exposures": tables.exposure_rows(calibration, observations),
        "rejections": tables.rejections(calibration, observations),
        "provenance": tables.provenance_rows(calibration.provenance),
    }


def _figures(
    calibration: Calibration,
    observations: Sequence[Observation],
    rig: Rig,
    registry: Registry,
    progress: Progress | None,
) -> dict[str, Any]:
    from markupsafe import Markup

    from rigcal.report import figures

    poses = {name: calibration.T(calibration.root, name) for name in calibration.sensors}
    boards = boards_in_root(calibration, observations, rig, registry)
    # What is not escaped: matplotlib escapes what it draws, JSON what it holds, scripts are ours.
    return {
        "rig_figure": Markup(figures.rig_figure(poses)),
        "scene": Markup(scene3d(calibration, rig, registry, boards)),
        "scripts": [Markup(_part(name)) for name in ("viewer.js", "sorting.js")],
        "style": Markup(_part("report.css")),
        "error_figures": _error_figures(calibration, observations, rig, registry, progress),
    }


def _error_figures(
    calibration: Calibration,
    observations: Sequence[Observation],
    rig: Rig,
    registry: Registry,
    progress: Progress | None,
) -> dict[str, str]:
    """Data URIs by sensor."""
    from rigcal.report.error_figures import error_figure

    tell = progress or (lambda *_: None)
    number = {name: i for i, name in enumerate(sorted_exposures(calibration.target_poses))}
    every, result = errors_by_sensor(calibration, observations, rig, registry), {}
    for done, (name, errors) in enumerate(every.items()):
        tell("drawing the report", done, len(every))
        order = np.array([number[exposure] for exposure in errors.exposures])
        kind = registry.sensor_type(rig.sensors[name].type)
        config = config_of(calibration, rig, registry, name)
        result[name] = error_figure(errors, kind, config, order)
    tell("drawing the report", len(every), len(every))
    return result


def _part(name: str) -> str:
    return (files("rigcal.report") / name).read_text(encoding="utf-8")
