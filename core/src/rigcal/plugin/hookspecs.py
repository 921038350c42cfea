"""The hooks of entry point group `rigcal`: they hand over frozen objects and compute nothing.

import rigcal.plugin as rp

@rp.hookimpl
def rigcal_sensor_types() -> list[rp.SensorType]:
return [SONAR]
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import pluggy

if TYPE_CHECKING:
    from rigcal.plugin.contract import SensorType
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
def rigcal_commands() -> Sequence[tuple[str, Any]]:  # type: ignore[empty-body]
    """Commands for the command line: (name, function with typer annotations)."""


@hookspec
def rigcal_schemas() -> Sequence[tuple[str, Any]]:  # type: ignore[empty-body]
    """Files that `rigcal schema` describes: (name, function (registry) -> JSON Schema)."""
