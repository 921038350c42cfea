"""verdict.yaml: what a recording determines, also where the result is withheld."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from rigcal.diagnosis.verdict import Verdict
from rigcal.errors import CalibrationError, NotConnectedError, NotDeterminedError
from rigcal.files import write_text

FORMAT, VERSION = "rigcal-verdict", 1
CONVENTION = (
    "sigma: one standard deviation about (rad) or along (m) the axes of the sensor's own frame, "
    "as seen from `reference`"
)


def verdict_of_error(error: CalibrationError) -> dict[str, Any]:
    """The verdict that an error holds, as plain data: `result: withheld`, and why."""
    content: dict[str, Any] = {"result": "withheld", "reason": str(error)}
    if isinstance(error, NotDeterminedError) and isinstance(error.verdict, Verdict):
        content |= error.verdict.as_mapping()
    if isinstance(error, NotConnectedError):
        content["groups"] = [list(group) for group in error.groups]
        content["would_join"] = [list(pair) for pair in error.joins]
    return content


def save_verdict(path: Path, content: dict[str, Any]) -> None:
    """Write verdict.yaml in one step."""
    head = {"format": FORMAT, "version": VERSION, "convention": CONVENTION}
    text = yaml.safe_dump({**head, **content}, sort_keys=False, width=100, allow_unicode=True)
    write_text(path, text)
