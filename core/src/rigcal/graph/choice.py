"""Which observations enter the graph of MSG-Cal: the pairs' inliers, or all of them."""

from __future__ import annotations

import itertools
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace

from rigcal.graph.exposure_graph import ExposureGraph
from rigcal.graph.msgcal import MsgcalGraph
from rigcal.graph.nodes import node, relation
from rigcal.graph.pairwise import PairResult
from rigcal.graph.task import Task

Chosen = Mapping[str, Mapping[str, int]]
"""The candidate of every sensor that is used, by exposure."""


def best_ranked(task: Task) -> dict[str, dict[str, int]]:
    """The first candidate of every observation that has any, in exposures that two sensors see."""
    chosen = {
        exposure: {s: 0 for s, o in seen.items() if o.candidates}
        for exposure, seen in task.exposures.items()
    }
    return {exposure: each for exposure, each in chosen.items() if len(each) > 1}


def inliers_of_pairs(pairs: Sequence[PairResult]) -> dict[str, dict[str, int]]:
    """The candidates that the pairs count among their inliers; most votes where they differ."""
    votes: defaultdict[tuple[str, str], Counter[int]] = defaultdict(Counter)
    for pair in pairs:
        for exposure, (i, j) in pair.inliers.items():
            votes[exposure, pair.a][i] += 1
            votes[exposure, pair.b][j] += 1
    chosen: defaultdict[str, dict[str, int]] = defaultdict(dict)
    for (exposure, sensor), counter in votes.items():
        chosen[exposure][sensor] = min(counter, key=lambda i: (-counter[i], i))
    return dict(chosen)


def msgcal_graph(
    task: Task, pairs: Sequence[PairResult], chosen: Chosen, *, filtered: bool
) -> MsgcalGraph:
    """The seed's graph over the chosen candidates.

    Filtered, two observations have an edge if their pair counts them among its inliers; otherwise
    all two of an exposure have one, where their geometries allow it. Observations without an edge
    have no node.
    """
    solved = {(p.a, p.b): p for p in pairs if p.T_a_b is not None}
    exposures = []
    for exposure, each in chosen.items():
        # In the order of the rig: the graph does not depend on which pair voted first.
        sensors = [s for s in task.rig.sensors if s in each]
        linked = [
            (a, b)
            for a, b in itertools.combinations(sensors, 2)
            if not filtered or _agree(solved, exposure, each, a, b)
        ]
        graph = _exposure_graph(task, exposure, each, linked)
        if graph.relations:
            exposures.append(graph)
    return MsgcalGraph(tuple(exposures), tuple(solved.values()))


def _agree(
    solved: Mapping[tuple[str, str], PairResult],
    exposure: str,
    each: Mapping[str, int],
    a: str,
    b: str,
) -> bool:
    for x, y in ((a, b), (b, a)):
        if (x, y) in solved:
            return solved[x, y].inliers.get(exposure) == (each[x], each[y])
    return False


def _exposure_graph(
    task: Task, exposure: str, each: Mapping[str, int], linked: Sequence[tuple[str, str]]
) -> ExposureGraph:
    seen, names = task.exposures[exposure], list(dict.fromkeys(s for link in linked for s in link))
    nodes = tuple(
        node(s, each[s], seen[s].candidates[each[s]].geometry, task.target(s)) for s in names
    )
    relations = [relation(nodes, names.index(a), names.index(b), task.target(a)) for a, b in linked]
    kept = tuple(r for r in relations if r is not None)
    used = sorted({i for r in kept for i in (r.a, r.b)})
    place = {i: n for n, i in enumerate(used)}
    return ExposureGraph(
        exposure,
        tuple(nodes[i] for i in used),
        tuple(replace(r, a=place[r.a], b=place[r.b]) for r in kept),
    )
