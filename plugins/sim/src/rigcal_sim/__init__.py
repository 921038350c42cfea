"""Simulated recordings with ground truth for rigcal."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rigcal.plugin import hookimpl


@hookimpl
def rigcal_commands() -> list[tuple[str, Callable[..., Any]]]:
    """`rigcal simulate` and `rigcal demo`."""
    from rigcal_sim.commands import demo, simulate

    return [("demo", demo), ("simulate", simulate)]
