"""The hooks of entry point group `rigcal`: they hand over frozen objects and compute nothing.

import rigcal.plugin as rp

@rp.hookimpl
def rigcal_sensor_types() -> list[rp.SensorType]:
return [SONAR]
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import pluggy

if TYPE_CHECKING:
    from rigcal.exporting.exporter import Exporter
    from rigcal.importing.importer import Importer
    from rigcal.plugin.contract import SensorType
    from rigcal.plugin.offer import Command, FileSchema
    from rigcal.recording.format import RecordingFormat
    from rigcal.targets.target import TargetType

PROJECT = "rigcal"
hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)


@hookspec
def rigcal_sensor_types() -> Sequence[SensorType]:  # type: ignore[empty-body]
    """Sensor types that may stand after `type:` in a rig's sensors."""


@hookspec
def rigcal_target_types() -> Sequence[TargetType]:  # type: ignore[empty-body]
    """Target types that may stand after `type:` in a rig's targets."""


@hookspec
def rigcal_recording_formats() -> Sequence[RecordingFormat]:  # type: ignore[empty-body]
    """Kinds of recordings that commands read, beside bags and folders of files."""


@hookspec
def rigcal_exporters() -> Sequence[Exporter]:  # type: ignore[empty-body]
    """Formats that may follow `rigcal export --format`."""


@hookspec
def rigcal_importers() -> Sequence[Importer]:  # type: ignore[empty-body]
    """Formats that `rigcal init --from` reads."""


@hookspec
def rigcal_commands() -> Sequence[Command]:  # type: ignore[empty-body]
    """Commands for the command line: (name, function with typer annotations).

    Every start of the command line asks for them: the module that implements this hook imports
    no numerical library, and a plugin with other offers gives its commands an entry point of
    their own.
    """


@hookspec
def rigcal_schemas() -> Sequence[FileSchema]:  # type: ignore[empty-body]
    """Files that `rigcal schema` describes: (name, function (registry) -> JSON Schema)."""
