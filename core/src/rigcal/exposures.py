"""Which frames of the sensors show the board in the same pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rigcal.observation import Observation
from rigcal.rig import Rig


@dataclass(frozen=True)
class FrameStamp:
    """One frame: its sensor, header stamp, key of its file name if any, and place in its stream."""

    sensor: str
    stamp_ns: int
    key: str | None
    index: int


def exposure_names(
    frames: Sequence[FrameStamp], association: str, tolerance_s: float
) -> list[str | None]:
    """The exposure of every frame; None for a frame that another one of its sensor stands for.

    Files that carry a key belong to the exposure of that key. "nearest": stamps that follow each
    other within `tolerance_s` are one exposure, and of a sensor's frames in it the nearest to the
    median stamp counts. "same_index": the n-th frames of all sensors are one exposure.
    """
    if association == "same_index":
        return [f.key if f.key is not None else f"{f.index:04d}" for f in frames]
    names: list[str | None] = [f.key for f in frames]
    stamped = [i for i, f in enumerate(frames) if f.key is None]
    if not stamped:
        return names
    stamps = np.array([frames[i].stamp_ns for i in stamped], dtype=np.int64)
    order = np.argsort(stamps, kind="stable")
    gaps = np.diff(stamps[order], prepend=stamps[order[0]]) > round(tolerance_s * 1e9)
    for number, members in enumerate(np.split(order, np.flatnonzero(gaps))):
        middle = int(np.median(stamps[members] - stamps[members[0]])) + int(stamps[members[0]])
        nearest: dict[str, int] = {}
        for i in sorted(members, key=lambda i: (abs(int(stamps[i]) - middle), i)):
            nearest.setdefault(frames[stamped[i]].sensor, i)
        for i in nearest.values():
            names[stamped[i]] = f"{number:04d}"
    return names


def association_of(association: str | None, observations: Sequence[Observation]) -> str:
    """How observations were grouped, given what the rig says: "still", "nearest", "same_index", or
    "file names" where files carry keys.
    """
    if any(len(o.frames) > 1 for o in observations if o.candidates):
        return "still"
    if association != "same_index" and not any(o.stamp_ns for o in observations):
        return "file names"
    return association or "nearest"


def by_exposure(observations: Sequence[Observation]) -> dict[str, dict[str, Observation]]:
    """Observations by exposure (in natural order) and sensor."""
    result: dict[str, dict[str, Observation]] = {}
    for o in sorted(observations, key=lambda o: _natural(o.exposure)):
        result.setdefault(o.exposure, {})[o.sensor] = o
    return result


def name_in_result(rig: Rig, observation: Observation) -> str:
    """The name of an observation's exposure in a calibration of the rig.

    Targets that stand in one exposure together have a pose each: with several targets, the name of
    the one that the sensor looks at follows.
    """
    name = observation.exposure
    return f"{name}/{rig.target_of(observation.sensor)}" if len(rig.targets) > 1 else name


def _natural(name: str) -> tuple[int, int, str]:
    return (0, int(name), name) if name.isdecimal() else (1, 0, name)
