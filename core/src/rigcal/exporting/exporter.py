"""A file format that calibrations are exported to, as a plugin hands it over."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rigcal.calibration import Calibration
    from rigcal.rig import Rig

Exported = str | Mapping[str, str]
"""The text of one file, or texts by file name for a folder."""


@dataclass(frozen=True)
class Exporter:
    """One format of other tools.

    name       what follows `rigcal export --format`: small letters, digits, _ and -
    summary    one line that says what the files are
    text       (calibration, rig) -> `Exported`; it computes and writes nothing. `rig` is None when
               the caller has none. The files say which way their transforms go, and the order of
               their quaternions
    needs_rig  whether `text` needs the rig: lenses, topics, and what else is not in a calibration
    """

    name: str
    summary: str
    text: Callable[[Calibration, Rig | None], Exported]
    needs_rig: bool = False
