"""What is estimated beside the poses, on request: numbers of sensors, scale and bend of targets.

They are one vector. Inside the solver each is counted in units of its own, the change that alone
would be too much, so that one number is like another.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rigcal.errors import NotDeterminedError
from rigcal.geometry.bend import height_by_bend
from rigcal.geometry.se3 import Array
from rigcal.graph.task import Task
from rigcal.plugin.contract import SensorConfig
from rigcal.plugin.refinable import Parameters
from rigcal.targets.target import Target

# The printed size is off by more than this only by a mistake.
_TOLERABLE_SCALE = 0.01
# Boards of wood or foam, leant against something, are seldom flatter.
_TOLERABLE_BEND_M = 0.002
_LISTED = 4
# So many times the tolerable error is as good as no information.
_UNKNOWN = 1e3
# What is held is known to this share of the tolerable error.
_HELD = 1e-6

SCALE = Parameters(
    names=("scale",),
    units=("",),
    values=np.ones(1),
    effect=np.array([[1 / _TOLERABLE_SCALE]]),
    tolerable=f"{100 * _TOLERABLE_SCALE:g} % of the target's size",
    advice="directions alone leave the scale open: add exposures in which a sensor that measures "
    "ranges sees the board in different places, or fix the pose between two sensors",
)


def bend_of(target: Target) -> Parameters:
    """The curvatures of a board, where they start; its rim may be off by 2 mm."""
    corners = target.outline
    rim = np.concatenate([corners, (corners + np.roll(corners, -1, axis=0)) / 2])
    return Parameters(
        names=("bend_x", "bend_y", "bend_xy"),
        units=("1/m",) * 3,
        values=target.bend,
        effect=height_by_bend(rim) / _TOLERABLE_BEND_M,
        tolerable=f"{1000 * _TOLERABLE_BEND_M:g} mm of height at the board's rim",
        advice="a camera sees a bend only where the board is tilted or near, a laser where many of "
        "its beams meet the board and their noise is small: add such exposures",
    )


@dataclass(frozen=True, eq=False)
class Group:
    """Numbers asked for under one name, of a sensor or a target: entries from `start` on."""

    owner: str
    name: str
    parameters: Parameters
    start: int
    is_target: bool = False

    @property
    def entries(self) -> slice:
        """Their place in the vector."""
        return slice(self.start, self.start + len(self.parameters.names))


@dataclass(frozen=True, eq=False)
class Numbers:
    """All groups, and the present `values` (Q,).

    `scaled` is the entry that scales the target of a sensor which measures directions only, `bent`
    are the entries that bend a sensor's target.
    """

    groups: tuple[Group, ...]
    values: Array
    scaled: Mapping[str, int]
    bent: Mapping[str, tuple[int, ...]]

    def __len__(self) -> int:
        return len(self.values)

    def of(self, sensor: str) -> list[int]:
        """The entries that a sensor's residuals depend on: in the order of its config's `refine`,
        then the bend of its target.
        """
        mine = [g.entries for g in self.groups if g.owner == sensor and not g.is_target]
        own = [i for entries in mine for i in range(entries.start, entries.stop)]
        return [*own, *self.bent.get(sensor, ())]

    def applied(self, sensor: str, task: Task) -> SensorConfig:
        """The sensor's config with the numbers as they are now."""
        config = task.rig.sensors[sensor]
        for g in self.groups:
            if g.owner == sensor and not g.is_target:
                config = task.kinds[sensor].refinable[g.name].apply(config, self.values[g.entries])
        return config

    def target(self, sensor: str, task: Task) -> Target:
        """The sensor's target, bent as the numbers are now."""
        target = task.target(sensor)
        if sensor not in self.bent:
            return target
        return target.bent(self.values[list(self.bent[sensor])])

    def seen(self, sensor: str, T_s_t: Array) -> Array:
        """The pose (..., 4, 4) at which a target of nominal size would look the same.

        To a sensor that measures directions a target s times as large looks like the nominal one
        at 1 / s of the distance.
        """
        if sensor not in self.scaled:
            return T_s_t
        seen = T_s_t.copy()
        seen[..., :3, 3] /= self.values[self.scaled[sensor]]
        return seen

    def stepped(self, step: Array) -> Numbers:
        """Moved by a step (Q,) in units."""
        return replace(self, values=self.values + self.unit * step)

    def held(self) -> Numbers:
        """As they are now, and so well known that an estimate leaves them there."""
        groups = []
        for g in self.groups:
            values, sigma = self.values[g.entries], _HELD * self.unit[g.entries]
            known = replace(g.parameters, values=values, prior_sigma=sigma)
            groups.append(replace(g, parameters=known))
        return replace(self, groups=tuple(groups))

    def covariance(self, in_units: Array) -> Array:
        """(Q, Q) in the numbers' own units."""
        result: Array = in_units * np.outer(self.unit, self.unit)
        return result

    @cached_property
    def unit(self) -> Array:
        """(Q,) the change of each that alone would be too much."""
        largest = [np.abs(g.parameters.effect).max(axis=0) for g in self.groups]
        return 1 / np.concatenate([*largest, np.zeros(0)])

    @cached_property
    def start(self) -> Array:
        """(Q,) where they start."""
        return np.concatenate([*(g.parameters.values for g in self.groups), np.zeros(0)])

    @cached_property
    def known(self) -> Array:
        """(Q,) information beforehand, in units."""
        sigmas = [
            np.full(len(p.names), np.inf) if p.prior_sigma is None else p.prior_sigma
            for p in (g.parameters for g in self.groups)
        ]
        result: Array = (self.unit / np.concatenate([*sigmas, np.zeros(0)])) ** 2
        return result

    @property
    def off_start(self) -> Array:
        """(Q,) from where they start, in units."""
        result: Array = (self.values - self.start) / self.unit
        return result


NO_NUMBERS = Numbers((), np.zeros(0), {}, {})


def numbers_of(task: Task) -> Numbers:
    """What the rig asks to refine, where it starts."""
    asked = [
        (sensor, name, task.kinds[sensor].refinable[name].parameters(config), False)
        for sensor, config in task.rig.sensors.items()
        for name in config.refine
    ]
    asked += [
        (t, name, SCALE if name == "scale" else bend_of(task.targets[t]), True)
        for t, config in task.rig.targets.items()
        for name in config.refine
    ]
    groups, count = list[Group](), 0
    for owner, name, parameters, is_target in asked:
        groups.append(Group(owner, name, parameters, count, is_target))
        count += len(parameters.names)
    at = {(g.owner, g.name): g.entries for g in groups if g.is_target}
    looks_at = {sensor: task.rig.target_of(sensor) for sensor in task.rig.sensors}
    scaled = {
        sensor: at[target, "scale"].start
        for sensor, target in looks_at.items()
        if task.kinds[sensor].angular and (target, "scale") in at
    }
    bent = {
        sensor: tuple(range(at[target, "bend"].start, at[target, "bend"].stop))
        for sensor, target in looks_at.items()
        if (target, "bend") in at
    }
    numbers = Numbers(tuple(groups), np.zeros(count), scaled, bent)
    return replace(numbers, values=numbers.start)


def check_determined(numbers: Numbers, covariance: Array, times: float = 1.0) -> None:
    """NotDeterminedError names what the data leave open by more than so many times the tolerable.

    covariance (Q, Q) is in units.
    """
    problems = []
    for g in numbers.groups:
        own, p = covariance[g.entries, g.entries], g.parameters
        effect = p.effect * numbers.unit[g.entries]
        worst = float(np.sqrt(np.einsum("mi,ij,mj->m", effect, own, effect).max()))
        if worst > times:
            much = f"{worst:.1f} times " if worst < _UNKNOWN else "far more than "
            problems.append(
                f"  {g.owner}: {g.name}: leaves {much}{p.tolerable} open; least known: "
                f"{_least_known(g, own, numbers.unit)}\n    {p.advice}"
            )
    if problems:
        raise NotDeterminedError(
            "the data do not determine what `refine` asks for; record more as said below, or take "
            "it out of `refine`:\n" + "\n".join(problems)
        )


def _least_known(group: Group, covariance: Array, unit: Array) -> str:
    """The numbers with the largest standard deviations in units, or the largest one."""
    sigma = np.sqrt(np.diagonal(covariance))
    order = [int(i) for i in np.argsort(-sigma, kind="stable")]
    listed = [i for i in order if sigma[i] > 1][:_LISTED] or order[:1]
    words = []
    for i in listed:
        size = f"+-{sigma[i] * unit[group.entries][i]:.2g} {group.parameters.units[i]}".strip()
        words.append(f"{group.parameters.names[i]} ({size if sigma[i] < _UNKNOWN else 'open'})")
    return ", ".join(words)
