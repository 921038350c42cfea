"""The verdict on a result: per sensor and axis, how well the data determine it, and why not."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

State = Literal["determined", "weak", "open"]
AXES = (*(f"rotation about {a}" for a in "xyz"), *(f"translation along {a}" for a in "xyz"))
"""Of the sensor's own frame, in the order of tangent vectors."""
PLAN = "`rigcal plan RIG --observations observations.npz` says where to show the board next."


@dataclass(frozen=True)
class Axis:
    """How well one axis is known: `sigma` (rad or m), infinite where it is open."""

    state: State
    sigma: float


@dataclass(frozen=True)
class SensorVerdict:
    """The six axes (order of `AXES`); for those that are weak or open, why, and what to record."""

    axes: tuple[Axis, ...]
    causes: tuple[str, ...] = ()
    advice: tuple[str, ...] = ()

    def named(self, state: State) -> list[str]:
        """The axes in a state, with their standard deviations where they have one."""
        return [
            name if np.isinf(axis.sigma) else f"{name} ({_size(axis.sigma, name)})"
            for name, axis in zip(AXES, self.axes, strict=True)
            if axis.state == state
        ]


@dataclass(frozen=True)
class Verdict:
    """All sensors but `reference`, in whose frame the axes were judged: the root, if it is one of
    the sensors that are known to each other.
    """

    reference: str
    sensors: Mapping[str, SensorVerdict]

    @property
    def withheld(self) -> tuple[str, ...]:
        """The sensors with an open axis."""
        return tuple(s for s, v in self.sensors.items() if v.named("open"))

    @property
    def weak(self) -> tuple[str, ...]:
        """The sensors with a weak axis and no open one."""
        weak = (s for s, v in self.sensors.items() if v.named("weak"))
        return tuple(s for s in weak if s not in self.withheld)

    @property
    def summary(self) -> str:
        """The verdict in one sentence."""
        count = len(self.sensors)
        if not count:
            return "No pose was estimated: all are given."
        if self.withheld:
            return f"The data do not determine the pose of {', '.join(self.withheld)}."
        if self.weak:
            return f"Every pose is determined, weakly that of {', '.join(self.weak)}."
        return "The pose is determined." if count == 1 else f"All {count} poses are determined."

    def lines(self) -> list[str]:
        """The summary, and for every sensor that falls short which axes, why, and what to do."""
        result = [self.summary]
        for sensor in (*self.withheld, *self.weak):
            result += _lines(sensor, self.sensors[sensor], self.reference)
        return result + [PLAN] * (len(result) > 1)

    def as_mapping(self) -> dict[str, Any]:
        """The same as plain data; `sigma` in rad and m, None where an axis is open."""
        return {
            "summary": self.summary,
            "reference": self.reference,
            "sensors": {
                name: {
                    "axes": {
                        axis_name.replace(" about", "").replace(" along", "").replace(" ", "_"): {
                            "state": axis.state,
                            "sigma": None if np.isinf(axis.sigma) else axis.sigma,
                        }
                        for axis_name, axis in zip(AXES, verdict.axes, strict=True)
                    },
                    "causes": list(verdict.causes),
                    "record": list(verdict.advice),
                }
                for name, verdict in self.sensors.items()
            },
        }


def _lines(sensor: str, verdict: SensorVerdict, reference: str) -> Iterable[str]:
    yield f"  {sensor}, about and along the axes of its own frame, as seen from {reference}:"
    if named := verdict.named("open"):
        yield f"    not determined: {', '.join(named)}"
    if named := verdict.named("weak"):
        yield f"    weak: {', '.join(named)}"
    yield from (f"    because {cause}" for cause in verdict.causes)
    yield from (f"    to record: {advice}" for advice in verdict.advice)


def _size(sigma: float, name: str) -> str:
    if name.startswith("rotation"):
        return f"+-{np.degrees(sigma):.2g} deg"
    return f"+-{1000 * sigma:.3g} mm"
