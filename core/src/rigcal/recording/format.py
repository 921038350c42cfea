"""A kind of recording as a plugin hands it over."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rigcal.recording.message import Definitions, Recording


@dataclass(frozen=True)
class RecordingFormat:
    """One kind of recording.

    name     what people call it: small letters, digits, _ and -
    accepts  (path) -> whether the path, which exists, is such a recording. It looks at the name
             and at the first bytes, not at all the data
    open     (path, definitions) -> `Recording`, opened for reading only: several processes hold
             the same one. `definitions` are of message types that a sensor's plugin brings.
             RecordingError for one that cannot be read
    """

    name: str
    accepts: Callable[[Path], bool]
    open: Callable[[Path, Definitions], Recording]
