"""What was recorded so far: where the sensors and boards are, and what it tells of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigcal.calibration import Calibration
from rigcal.diagnosis.observability import judge
from rigcal.errors import ConfigError, NotConnectedError
from rigcal.estimation import prepare
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph import global_estimate
from rigcal.graph.known import known_information
from rigcal.graph.method import Method
from rigcal.graph.numbers import Numbers, numbers_of
from rigcal.graph.solve import Solution
from rigcal.graph.stack import EdgeStack, poses_of
from rigcal.graph.stages import given_poses
from rigcal.graph.task import Task
from rigcal.observation import Observation
from rigcal.plugin.registry import Registry
from rigcal.progress import Progress
from rigcal.rig import Rig, build_targets

Link = tuple[str, str, Array]
"""Sensors a and b, and `T_a_b` (4, 4)."""


@dataclass(frozen=True, eq=False)
class Recorded:
    """`T_root_s` of all sensors; `information` (6 S + Q, 6 S + Q) of their poses and `numbers`.

    No sensor is held. The Q numbers are what the rig asks to refine, in units. `boards` are targets
    and `T_root_t` (4, 4), `scales` the sensors' noise over the configured one. `loose` are groups
    of sensors that nothing joins to the root; they are where the rig file or a calibration has
    them.
    """

    T_root_s: Mapping[str, Array]
    numbers: Numbers
    information: Array
    boards: tuple[tuple[str, Array], ...]
    scales: Mapping[str, float]
    loose: tuple[tuple[str, ...], ...]


def nothing_recorded(rig: Rig, registry: Registry, calibration: Calibration | None) -> Recorded:
    """Poses from the rig file or a calibration alone.

    ConfigError names the sensors whose poses neither gives.
    """
    T_root_s = _placed(rig, {rig.root: np.eye(4)}, (), _links(rig, calibration))
    numbers = _numbers(rig, registry)
    beforehand = np.diag(np.concatenate([np.zeros(6 * len(T_root_s)), numbers.known]))
    return Recorded(T_root_s, numbers, beforehand, (), {}, ())


def recorded(
    rig: Rig,
    registry: Registry,
    observations: Sequence[Observation],
    calibration: Calibration | None,
    seed: int,
    progress: Progress | None,
) -> Recorded:
    """Calibrated from the observations, group by group where nothing links all sensors.

    Poses that the observations leave open are those in `calibration` or in the rig file, and one of
    many that explain the observations where neither has them. Groups hang from each other by those
    poses too; ConfigError names the sensors that nothing places.
    """
    given = _links(rig, calibration)
    groups = [
        (own, _settled(own, registry, found, given))
        for own, found in _groups(rig, registry, observations, seed, progress)
    ]
    within = [
        (own.root, s, T) for own, found in groups for s, T in found.sensors.items() if s != own.root
    ]
    poses, fixed = given_poses(rig)
    joined = _reached({s: poses[s] for s in poses if s in fixed}, within)
    T_root_s = _placed(rig, joined, within, given)
    at = {s: i for i, s in enumerate(rig.sensors)}
    numbers = _numbers(rig, registry)
    values = numbers.values.copy()
    information = np.zeros((6 * len(at) + len(numbers), 6 * len(at) + len(numbers)))
    boards: list[tuple[str, Array]] = []
    scales: dict[str, float] = {}
    for own, found in groups:
        entries = _entries(numbers, found.numbers)
        values[entries] = found.numbers.values
        rows = [6 * at[s] + i for s in found.sensors for i in range(6)]
        rows += [6 * len(at) + i for i in entries]
        information[np.ix_(rows, rows)] += _known(found)
        scales |= found.scales if rig.noise == "estimated" else {}
        seen_by = {e.exposure: e.sensor for e in found.edges}
        boards += [
            (rig.target_of(seen_by[k]), T_root_s[own.root] @ T)
            for k, T in found.targets.items()
            if k in seen_by
        ]
    linked = [tuple(found.sensors) for own, found in groups if own.root not in joined]
    alone = set(rig.sensors).difference(joined, *linked)
    loose = (*linked, *((s,) for s in rig.sensors if s in alone))
    numbers = replace(numbers, values=values)
    return Recorded(T_root_s, numbers, information, tuple(boards), scales, loose)


def _groups(
    rig: Rig,
    registry: Registry,
    observations: Sequence[Observation],
    seed: int,
    progress: Progress | None,
) -> list[tuple[Rig, Solution]]:
    """The sensors that hang together, as rigs of their own, and their solutions."""
    seen = {o.sensor for o in observations if o.candidates}
    names = [s for s in rig.sensors if s in seen]
    if len(names) < 2:
        return []
    whole = _part(rig, names)
    try:
        return [_solved(whole, registry, observations, seed, progress)]
    except NotConnectedError as error:
        parts = [_part(rig, [s for s in rig.sensors if s in group]) for group in error.groups]
    return [
        _solved(part, registry, observations, seed, progress)
        for part in parts
        if len(part.sensors) > 1
    ]


def _solved(
    rig: Rig,
    registry: Registry,
    observations: Sequence[Observation],
    seed: int,
    progress: Progress | None,
) -> tuple[Rig, Solution]:
    # Observations of sensors beyond the rig are refused by `prepare`, if they are none of ours.
    own = [o for o in observations if o.sensor in rig.sensors]
    stages = prepare(rig, registry, own, seed, progress)
    return rig, global_estimate.solve(stages, Method(accept_weak=True), progress).solution


def _settled(rig: Rig, registry: Registry, found: Solution, given: Sequence[Link]) -> Solution:
    """The solution with given poses of the sensors whose own the data leave open."""
    flat = frozenset(s for s, c in rig.sensors.items() if registry.sensor_type(c.type).flat)
    _, held = given_poses(rig)
    verdict = judge(found.edges, found.sensors, found.targets, held, rig.root, flat, found.numbers)
    known = {s: T for s, T in found.sensors.items() if s not in verdict.withheld}
    if not verdict.withheld:
        return found
    T_s = {**found.sensors, **_reached(known, given)}
    boards = _moved(found, T_s)
    T_new_root = se3.inverse(T_s[rig.root])
    return replace(
        found,
        sensors={s: T_new_root @ T_s[s] for s in found.sensors},
        targets={k: T_new_root @ T for k, T in boards.items()},
    )


def _moved(found: Solution, T_s: Mapping[str, Array]) -> dict[str, Array]:
    """The boards where the sensors are at `T_s`: each goes with the sensor that knows it best."""
    stack = EdgeStack(found.edges, list(found.sensors), list(found.targets), found.numbers)
    T_s_t = stack.relative(poses_of(found.sensors), poses_of(found.targets))
    H = stack.blocks(T_s_t, numbers=found.numbers).H[:, :6, :6]
    order = np.argsort(np.linalg.eigvalsh(H)[:, 0], kind="stable")
    best = {found.edges[i].exposure: (found.edges[i].sensor, T_s_t[i]) for i in order}
    return {k: T_s[s] @ T for k, (s, T) in best.items()}


def _part(rig: Rig, names: Sequence[str]) -> Rig:
    """The rig with these sensors, and of the poses that it prescribes those that hang there."""
    if len(names) == len(rig.sensors):
        return rig
    hangs = {rig.root} & {*names}
    while more := {s for s in names if s not in hangs and _given_parent(rig, s) in hangs}:
        hangs |= more
    free = {"pose": None, "initial": None, "fixed": False}
    sensors = {
        s: rig.sensors[s] if s in hangs else rig.sensors[s].model_copy(update=free) for s in names
    }
    return replace(rig, root=rig.root if rig.root in sensors else names[0], sensors=sensors)


def _given_parent(rig: Rig, sensor: str) -> str | None:
    """What the rig file prescribes a sensor's pose in, if it does."""
    config = rig.sensors[sensor]
    is_given = config.pose is not None and (config.fixed or config.initial)
    return config.pose.parent if config.pose is not None and is_given else None


def _known(solution: Solution) -> Array:
    """(6 S + Q, 6 S + Q) information of the sensors' poses and what was refined beside them."""
    M = known_information(
        solution.edges, solution.sensors, solution.targets, frozenset(), solution.numbers
    )
    values, vectors = np.linalg.eigh((M + M.T) / 2)
    result: Array = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return result


def _numbers(rig: Rig, registry: Registry) -> Numbers:
    """What the rig asks to refine, where it starts."""
    kinds = {name: registry.sensor_type(c.type) for name, c in rig.sensors.items()}
    return numbers_of(Task(rig, kinds, build_targets(rig, registry), {}))


def _entries(numbers: Numbers, part: Numbers) -> list[int]:
    """The entries in all numbers of those of a part of the rig."""
    start = {(g.owner, g.name): g.start for g in numbers.groups}
    return [
        start[g.owner, g.name] + i
        for g in part.groups
        for i in range(g.entries.stop - g.entries.start)
    ]


def _links(rig: Rig, calibration: Calibration | None) -> list[Link]:
    """Poses that were given, those of a calibration first."""
    links: list[Link] = []
    if calibration is not None:
        known = [s for s in calibration.sensors if s in rig.sensors]
        links += [(known[0], s, calibration.T(known[0], s)) for s in known[1:]]
    poses = {s: c.pose for s, c in rig.sensors.items() if c.pose is not None}
    return links + [(pose.parent, s, pose.T_parent_sensor) for s, pose in poses.items()]


def _reached(T_root_s: Mapping[str, Array], links: Sequence[Link]) -> dict[str, Array]:
    """The poses, and those that links lead to; earlier links go before later ones."""
    T = dict(T_root_s)
    while step := next((link for link in links if (link[0] in T) != (link[1] in T)), None):
        a, b, T_a_b = step
        if a in T:
            T[b] = T[a] @ T_a_b
        else:
            T[a] = T[b] @ se3.inverse(T_a_b)
    return T


def _placed(
    rig: Rig, T_root_s: Mapping[str, Array], within: Sequence[Link], given: Sequence[Link]
) -> dict[str, Array]:
    """`T_root_s` of all sensors of the rig, in its order."""
    T = _reached(T_root_s, [*within, *given])
    if missing := [s for s in rig.sensors if s not in T]:
        by = "neither the observations nor the rig file join" if within else "the rig file gives"
        raise ConfigError(
            f"{by} {'no pose of ' if not within else ''}{', '.join(missing)} "
            f"{'to' if within else 'as seen from'} the root '{rig.root}': write a rough "
            "`pose: {parent: ..., ...}` into the rig file, or give a calibration that has them; a "
            "plan needs to know where their views meet"
        )
    return {s: T[s] for s in rig.sensors}
