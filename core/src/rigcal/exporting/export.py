"""Exports a calibration through the exporters of the installed plugins."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rigcal.calibration import Calibration
from rigcal.errors import InputError, PluginError, RigcalError
from rigcal.exporting.exporter import Exported
from rigcal.files import write_text
from rigcal.plugin.checks import kind_of
from rigcal.plugin.registry import Registry
from rigcal.refined import rig_as_refined
from rigcal.rig import Rig


def export(
    calibration: Calibration, registry: Registry, form: str, rig: Rig | None = None
) -> Exported:
    """The calibration as text of format `form`, or texts by file name if it has several files.

    `rig` is needed by formats that hold more than poses; of what was refined beside the poses, such
    as lenses, they get what was found. PluginError for an unknown format, or one
    whose plugin fails; InputError when the rig is missing or lacks a sensor.
    """
    exporter = registry.exporter(form)
    if rig is None and exporter.needs_rig:
        raise InputError(
            f"format '{form}' holds more than a calibration says; give the rig too (`--rig RIG`)"
        )
    if rig is not None:
        rig = _as_calibrated(calibration, rig, registry)
    try:
        text = exporter.text(calibration, rig)
    except RigcalError:
        raise
    except (Exception, SystemExit) as error:
        raise PluginError(
            f"exporter '{form}' failed with {type(error).__name__}: {error}"
        ) from error
    _check(form, text)
    return text


def write_export(
    path: Path | str,
    calibration: Calibration,
    registry: Registry,
    form: str,
    rig: Rig | None = None,
) -> tuple[Path, ...]:
    """Write what `export` returns: to a file, or to files of the folder `path`.

    Returns their paths. InputError when the place cannot be written to.
    """
    path = Path(path)
    text = export(calibration, registry, form, rig)
    texts = {path: text} if isinstance(text, str) else {path / n: t for n, t in text.items()}
    for file, content in texts.items():
        write_text(file, content)
    return tuple(texts)


def _as_calibrated(calibration: Calibration, rig: Rig, registry: Registry) -> Rig:
    if unknown := sorted(set(calibration.sensors) - set(rig.sensors)):
        raise InputError(
            f"the calibration has {', '.join(unknown)}, which the rig does not "
            f"(it has {', '.join(rig.sensors)}); use the rig file that it was made with"
        )
    return rig_as_refined(rig, registry, calibration)


def _check(form: str, text: object) -> None:
    if isinstance(text, str):
        return
    if not isinstance(text, Mapping):
        raise PluginError(f"exporter '{form}' answered {kind_of(text)}, expected text")
    for name, content in text.items():
        whole = isinstance(name, str) and isinstance(content, str)
        if not whole or Path(name).name != name:
            raise PluginError(
                f"exporter '{form}' answered the file {name!r}, expected text by file name"
            )
