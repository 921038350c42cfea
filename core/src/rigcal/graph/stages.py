"""What comes before a global estimate, done once: every pair of sensors, and their tree."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigcal.errors import ConfigError
from rigcal.geometry.se3 import Array
from rigcal.graph.choice import best_ranked, inliers_of_pairs, msgcal_graph
from rigcal.graph.loops import check_loops
from rigcal.graph.loose import loosely
from rigcal.graph.method import Method
from rigcal.graph.msgcal import MsgcalGraph
from rigcal.graph.pairwise import PairResult, calibrate_pair
from rigcal.graph.relate import pairing_of
from rigcal.graph.task import Task
from rigcal.graph.tree import components, spanning_tree
from rigcal.observation import Observation
from rigcal.plugin.contract import PoseConfig
from rigcal.progress import Progress
from rigcal.rig import Rig


@dataclass(frozen=True, eq=False)
class Stages:
    """The pairs of a task, and the poses `T_root_s` that their spanning tree gives the sensors.

    `fixed` names the sensors that keep their poses, the root among them; `given` holds poses that
    the rig prescribes. Loose pairs are among `pairs` where the others do not join all sensors.
    `warnings` tells of pairs that contradict each other.
    """

    task: Task
    pairs: tuple[PairResult, ...]
    T_root: Mapping[str, Array]
    given: Mapping[str, Array]
    fixed: frozenset[str]
    seed: int
    warnings: tuple[str, ...] = ()

    @property
    def is_loose(self) -> bool:
        """Whether the tree hangs together only by pairs whose exposures leave them open."""
        return any(pair.is_loose for pair in self.pairs)

    def graph(self, *, filtered: bool = True) -> MsgcalGraph:
        """The graph of MSG-Cal over the pairs' inliers, or over all data."""
        chosen = inliers_of_pairs(self.pairs) if filtered else best_ranked(self.task)
        return msgcal_graph(self.task, self.pairs, chosen, filtered=filtered)

    def start(self, method: Method) -> dict[str, Array]:
        """First poses of the sensors."""
        if method.initial == "tree":
            return dict(self.T_root)
        return {s: self.given.get(s, np.eye(4)) for s in self.T_root}


def first_stages(task: Task, seed: int, progress: Progress | None = None) -> Stages:
    """Pairs and spanning tree; NotConnectedError if the pairs do not join all sensors, ConfigError
    for given poses that lead to no known one.

    A pair that loops show to be wrong does not count.
    """
    given, fixed = given_poses(task.rig)
    pairs, warnings = check_loops(pairwise(task, seed, progress or (lambda *_: None)))
    groups = components(task.rig.sensors, pairs, given)
    if len(groups) > 1:
        pairs = tuple(_loosened(task, seed, groups, pair) for pair in pairs)
    T_root, _ = spanning_tree(task.rig.root, list(task.rig.sensors), pairs, given)
    return Stages(task, pairs, T_root | given, given, fixed, seed, warnings)


def pairwise(task: Task, seed: int, tell: Progress) -> list[PairResult]:
    """Every pair of sensors that look at one target; the order in a pair is one that determines."""
    names = list(itertools.combinations(task.rig.sensors, 2))
    results = []
    for done, (a, b) in enumerate(names):
        tell("pairs of sensors", done, len(names))
        if task.rig.target_of(a) != task.rig.target_of(b):
            continue
        rng, shared = _stream(seed, a, b), _shared(task, a, b)
        if shared and not _determines(shared[0]) and _determines(shared[0][::-1]):
            a, b, shared = b, a, [(y, x) for x, y in shared]
        result = calibrate_pair(shared, task.target(a), rng, (a, b))
        results.append(replace(result, can_join=_can_join(task, a, b)))
    tell("pairs of sensors", len(names), len(names))
    return results


def _can_join(task: Task, a: str, b: str) -> bool:
    """Whether what a and b see of boards, together or not, determines a transform."""
    first = [
        next(seen[s] for seen in task.exposures.values() if s in seen and seen[s].candidates)
        for s in (a, b)
    ]
    return _determines((first[0], first[1])) or _determines((first[1], first[0]))


def _loosened(
    task: Task, seed: int, groups: Sequence[Collection[str]], pair: PairResult
) -> PairResult:
    """A pair between two groups that only leaves its transform open, with one of many."""
    if not pair.shared or any(pair.a in group and pair.b in group for group in groups):
        return pair
    shared, rng = _shared(task, pair.a, pair.b), _stream(seed, pair.a, pair.b)
    return loosely(shared, task.target(pair.a), rng, pair)


def _stream(seed: int, a: str, b: str) -> np.random.Generator:
    """A stream of its own for every pair: the result does not depend on the other pairs."""
    digest = hashlib.sha256(f"{seed}/{a}/{b}".encode()).digest()
    return np.random.default_rng(np.frombuffer(digest, dtype=np.uint32))


def _shared(task: Task, a: str, b: str) -> list[tuple[Observation, Observation]]:
    """What both sensors saw, of the exposures in which they did."""
    return [
        (seen[a], seen[b])
        for seen in task.exposures.values()
        if a in seen and b in seen and seen[a].candidates and seen[b].candidates
    ]


def _determines(pair: tuple[Observation, Observation]) -> bool:
    a, b = (o.candidates[0].geometry for o in pair)
    return pairing_of(a, b) is not None


def given_poses(rig: Rig) -> tuple[dict[str, Array], frozenset[str]]:
    """Poses `T_root_s` that the rig prescribes, and which sensors keep theirs (with the root)."""
    given, fixed = {rig.root: np.eye(4)}, {rig.root}
    pending = {n for n, c in rig.sensors.items() if (c.fixed or c.initial) and n != rig.root}
    while pending:
        ready = {n for n in pending if _pose(rig, n).parent in given}
        if not ready:
            raise ConfigError(
                f"sensors.{min(pending)}: `fixed` and `initial` need a parent whose pose is known: "
                f"the root '{rig.root}', or a sensor with `fixed` or `initial` of its own"
            )
        for n in sorted(ready):
            pose = _pose(rig, n)
            given[n] = given[pose.parent] @ pose.T_parent_sensor
            if rig.sensors[n].fixed and pose.parent in fixed:
                fixed.add(n)
            elif rig.sensors[n].fixed:
                raise ConfigError(
                    f"sensors.{n}: fixed to '{pose.parent}', which is estimated itself; "
                    "fix the parent too, or hang this sensor from the root"
                )
        pending -= ready
    return given, frozenset(fixed)


def _pose(rig: Rig, name: str) -> PoseConfig:
    pose = rig.sensors[name].pose
    assert pose is not None  # the config was validated
    return pose
