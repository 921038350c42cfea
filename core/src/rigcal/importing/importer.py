"""A file of another tool that tells something of a rig, as a plugin hands its format over."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from rigcal.geometry.se3 import Array

Frames = Mapping[str, tuple[str, Array]]
"""Parent and pose `T_parent_frame` (4, 4) of frames, by name."""


@dataclass(frozen=True, eq=False)
class Imported:
    """What a file says.

    sensors  fields of their configs (rig.yaml), by the name that the file has for each sensor;
             `type` is one of them, `topic` too where the file knows it
    frames   poses of frames; a sensor's own frame has the name that it has in `sensors`, or that
             its messages carry
    """

    sensors: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    frames: Frames = field(default_factory=dict)


@dataclass(frozen=True)
class Importer:
    """One format of other tools, known by what a file holds.

    name     what people call it: small letters, digits, _ and -
    summary  one line that says what the files are
    read     (text, stem of the file's name) -> `Imported`, or None for a file of another format;
             ConfigError, without the file's name, for one of this format that cannot be used
    """

    name: str
    summary: str
    read: Callable[[str, str], Imported | None]
