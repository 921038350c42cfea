"""Simulated recordings with ground truth for rigcal.

    rig = rigcal.load_rig("rig.yaml", registry)
    scenario = load_scenario("scenario.yaml", rig, registry)
    summary = simulate(rig, registry, scenario, seed=0, out="simulated")

Names are imported when they are first used: the command line must not load numpy to start.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Any

from rigcal.plugin import hookimpl

if TYPE_CHECKING:
    from rigcal.plugin import Registry
    from rigcal_sim.dataset import Summary, simulate
    from rigcal_sim.scenario_file import load_scenario

_HOME = {"Summary": "dataset", "load_scenario": "scenario_file", "simulate": "dataset"}
__all__ = ["Summary", "load_scenario", "simulate"]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"rigcal_sim.{_HOME[name]}"), name)
    raise AttributeError(f"module 'rigcal_sim' has no attribute '{name}'")


@hookimpl
def rigcal_commands() -> list[tuple[str, Callable[..., Any]]]:
    """`rigcal simulate`, `rigcal demo` and `rigcal experiment`."""
    from rigcal_sim.commands import demo, simulate
    from rigcal_sim.experiment.command import experiment

    return [("demo", demo), ("experiment", experiment), ("simulate", simulate)]


@hookimpl
def rigcal_schemas() -> list[tuple[str, Callable[..., dict[str, Any]]]]:
    """`rigcal schema scenario`."""
    return [("scenario", _scenario_schema)]


def _scenario_schema(registry: Registry) -> dict[str, Any]:
    from rigcal_sim.scenario_file import scenario_schema

    return scenario_schema(registry)
