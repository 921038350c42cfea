"""`rigcal validate`: what it prints of a cross-validation and a bootstrap."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigcal.resampling import Bootstrap, CrossValidation, Fold, HeldOut, Scatter

Validate = Callable[..., Any]
FOLDS = (Fold(("1", "2")), Fold(("3",)))
SENSORS = {"bow": HeldOut("m", 40, 0.01, 0.0115), "stern": HeldOut("px", 20, 0.2, 0.25)}
LIMIT = 0.002 * 86.661
"""0.1 and 0.02 are mean and deviation of 0.002 chi-square with 50 degrees of freedom, whose 99.9 %
point is 86.661 in the tables.
"""


@pytest.fixture
def validate(place: Path, monkeypatch: pytest.MonkeyPatch, command: Callable[..., Any]) -> Validate:
    """`validate(excess, folds, arguments)`: the command, with this outcome."""

    def run(*arguments: str, excess: float = 0.12, folds: tuple[Fold, ...] = FOLDS) -> Any:
        folded = CrossValidation(folds, SENSORS, excess, 0.1, 0.02)
        monkeypatch.setattr("rigcal.resampling.cross_validate", lambda *_: folded)
        return command("validate", "rig.yaml", "recording", *arguments)

    return run


def test_verdict_stands_beside_its_limit(validate: Validate) -> None:
    ran = validate()
    assert ran.code == 0
    assert "10.000 mm" in ran.out
    assert "0.2500 px" in ran.out
    assert (
        "Held out, their sum of squares is 12 % larger than fitted; expected from the covariance: "
        "10 +- 2 %, and more than 17 % once in 1000 times.\n"
        "The result holds for exposures that it has not seen.\n"
    ) in ran.out
    assert "check that the board stood still" in validate(excess=LIMIT + 1e-3).out
    assert "holds" in validate(excess=LIMIT - 1e-3).out


def test_exposures_that_the_result_rests_on_are_named(validate: Validate) -> None:
    folds = (FOLDS[0], Fold(("3", "7"), "nothing links: {bow}; {stern}"))
    ran = validate(folds=folds)
    assert (
        "warning: without the 2 exposures of fold 2 (3, 7) there is no result: nothing links: "
        "{bow}; {stern}\nThe result rests on single exposures: record more of the kind"
    ) in ran.out


def test_programs_get_all_of_it(validate: Validate, monkeypatch: pytest.MonkeyPatch) -> None:
    answer = json.loads(validate("--json").out)
    assert (answer["holds"], answer["excess"]) == (True, 0.12)
    assert answer["limit"] == pytest.approx(LIMIT, abs=1e-6)
    assert answer["folds"][0] == {"exposures": ["1", "2"], "problem": ""}
    assert answer["sensors"]["bow"]["held_out_rms"] == 0.0115
    assert "bootstrap" not in answer
    drawn = Bootstrap({"stern": Scatter(np.eye(6) * 4e-6, np.eye(6) * 1e-6)}, 30, 2)
    monkeypatch.setattr("rigcal.resampling.bootstrap", lambda *_: drawn)
    answer = json.loads(validate("--bootstrap", "32", "--json").out)["bootstrap"]
    assert (answer["draws"], answer["failed"]) == (30, 2)
    assert answer["sensors"]["stern"]["covariance"][5][5] == 4e-6
    assert validate("--bootstrap", "32", "--quiet") == (0, "", "")
    text = validate("--bootstrap", "32").out
    assert "over 30 draws of the exposures; 2 more had no answer" in text
    assert "warning" not in text


def test_a_scatter_beyond_sigma_is_a_warning(
    validate: Validate, monkeypatch: pytest.MonkeyPatch
) -> None:
    reported = np.eye(6) * 1e-6
    scatters = {
        "bow": Scatter(np.diag([16.0] * 3 + [1.0] * 3) * 1e-6, reported),
        "stern": Scatter(np.eye(6) * 1e-6, reported),
    }
    monkeypatch.setattr("rigcal.resampling.bootstrap", lambda *_: Bootstrap(scatters, 30, 0))
    text = validate("--bootstrap", "30").out
    assert "warning: bow scatters 4 times its sigma: it rests on few exposures, or" in text
    assert "stern scatters" not in text
