"""Simulated recordings with ground truth for rigcal."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rigcal.plugin import hookimpl

if TYPE_CHECKING:
    from rigcal.plugin import Registry


@hookimpl
def rigcal_commands() -> list[tuple[str, Callable[..., Any]]]:
    """`rigcal simulate` and `rigcal demo`."""
    from rigcal_sim.commands import demo, simulate

    return [("demo", demo), ("simulate", simulate)]


@hookimpl
def rigcal_schemas() -> list[tuple[str, Callable[..., dict[str, Any]]]]:
    """`rigcal schema scenario`."""
    return [("scenario", _scenario_schema)]


def _scenario_schema(registry: Registry) -> dict[str, Any]:
    from rigcal_sim.scenario_file import scenario_schema

    return scenario_schema(registry)
