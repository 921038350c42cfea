"""`rigcal plan`: what it prints of sensors that are open, not joined, or not planned for."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigcal.planning import Plan, Sigma
from rigcal.planning.result import Proposal

OPEN = float("inf")
RECORDED = {"stern": Sigma(0.0123, OPEN), "mast": Sigma(OPEN, OPEN)}
AFTER = {"stern": Sigma(0.0012, 0.0005), "mast": Sigma(OPEN, OPEN)}
WORDS = "2.0 m in front of bow"
UNPLANNED = {"mast": "its plugin does not say what it would see"}


def _plan(recorded: bool) -> Plan:
    T, up = np.eye(4), np.array([0.0, 0.0, 1.0])
    if not recorded:
        return Plan("bow", {}, {1: AFTER, 20: RECORDED}, None, (), (), up, (), UNPLANNED)
    proposal = Proposal("board", T, ("bow", "stern"), WORDS, AFTER)
    return Plan("bow", {}, {}, RECORDED, (proposal,), (), up, ("stern",), UNPLANNED)


@pytest.fixture
def plan(place: Path, monkeypatch: pytest.MonkeyPatch, command: Callable[..., Any]) -> Any:
    def run(*arguments: str, recorded: bool = True) -> Any:
        monkeypatch.setattr("rigcal.planning.plan", lambda *_: _plan(recorded))
        return command("plan", "rig.yaml", *arguments)

    return run


def test_open_sensors_are_named_with_the_reason(plan: Any) -> None:
    ran = plan()
    assert ran.code == 0
    assert ran.out.startswith(
        "stern is not joined to the others by what was recorded.\n"
        "mast is not planned for: its plugin does not say what it would see.\n"
    )
    cells = [" ".join(line.split()) for line in ran.out.splitlines()]
    assert "stern 12 mm, open (deg) 1.2 mm, 0.029 deg" in cells
    assert "mast open open" in cells
    # The mast stays as open as it is: no pose is judged by it.
    assert (
        f"1. {WORDS}\n   seen by bow, stern; the worst is then stern: 1.2 mm, 0.029 deg" in ran.out
    )


def test_programs_read_null_where_it_is_open(plan: Any) -> None:
    answer = json.loads(plan("--json").out)
    assert answer["recorded"]["mast"] == {"mm": None, "deg": None}
    assert answer["recorded"]["stern"] == {"mm": pytest.approx(12.3), "deg": None}
    assert answer["unjoined"] == ["stern"]
    assert answer["unplanned"] == UNPLANNED


def test_prediction_counts_exposures(plan: Any) -> None:
    ran = plan(recorded=False)
    assert "1 exposure  " in ran.out
    assert "20 exposures" in ran.out
    assert "Show the board next" not in ran.out
    assert plan("--quiet", recorded=False) == (0, "", "")
