"""First poses of all sensors: the maximum spanning tree of the pairs from the root."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import networkx as nx
import numpy as np

from rigcal.errors import NotConnectedError, TargetSizeError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.pairwise import PairResult

# A radian of rotation weighs like so many metres when pairs are compared.
_LEVER_M = 1.0


def spanning_tree(
    root: str, sensors: Sequence[str], pairs: Sequence[PairResult], given: Mapping[str, Array]
) -> tuple[dict[str, Array], tuple[PairResult, ...]]:
    """`T_root_s` (4, 4) of every sensor, and the pairs that the tree uses.

    Pairs weigh by their information: the path to a sensor has the smallest summed variance that a
    tree offers. `given` are poses `T_root_s` that the rig config prescribes. NotConnectedError
    names the components, and for every pair between two of them why it does not join them;
    TargetSizeError if the sensors contradict the target's dimensions.
    """
    _check_target_size(pairs)
    graph = _graph(sensors, pairs, given)
    groups = components(sensors, pairs, given)
    if len(groups) > 1:
        raise _not_connected(root, groups, pairs)
    poses = {root: np.eye(4)}
    used = []
    tree = nx.minimum_spanning_tree(graph, weight="weight")
    for parent, child in nx.bfs_edges(tree, root):
        pair = tree.edges[parent, child]["pair"]
        if pair is None:
            poses[child] = given[child]
        elif pair.a == parent:
            poses[child] = poses[parent] @ pair.T_a_b
        else:
            poses[child] = poses[parent] @ se3.inverse(pair.T_a_b)
        used.extend([pair] if pair is not None else [])
    return poses, tuple(used)


def components(
    sensors: Iterable[str], pairs: Sequence[PairResult], given: Mapping[str, Array]
) -> list[set[str]]:
    """The groups of sensors that pairs join, or poses `given`, of which the root's is the first."""
    return list(nx.connected_components(_graph(sensors, pairs, given)))


def _graph(
    sensors: Iterable[str], pairs: Sequence[PairResult], given: Mapping[str, Array]
) -> nx.Graph[str]:
    graph: nx.Graph[str] = nx.Graph()
    graph.add_nodes_from(sensors)
    root, *others = given
    for name in others:
        graph.add_edge(root, name, weight=0.0, pair=None)
    for pair in pairs:
        if pair.T_a_b is not None and not graph.has_edge(pair.a, pair.b):
            graph.add_edge(pair.a, pair.b, weight=_variance(pair), pair=pair)
    return graph


def _check_target_size(pairs: Sequence[PairResult]) -> None:
    """TargetSizeError if more pairs contradict the target's dimensions than confirm them."""
    scales = {f"{p.a} - {p.b}": p.target_scale for p in pairs if p.target_scale is not None}
    if len(scales) > sum(p.tests_size and p.T_a_b is not None for p in pairs):
        each = ", ".join(f"{pair}: {scale:.2f}" for pair, scale in scales.items())
        raise TargetSizeError(
            "the target's dimensions in the rig file contradict the ranges of the lasers: the "
            f"sensors would agree if it were {np.median(list(scales.values())):.2f} times as large "
            f"({each}). Measure the printed target and correct its sizes in metres"
        )


def _variance(pair: PairResult) -> float:
    assert pair.covariance is not None
    variances = np.diagonal(pair.covariance)
    return float(variances[:3].sum() * _LEVER_M**2 + variances[3:].sum())


def _not_connected(
    root: str, groups: Sequence[set[str]], pairs: Sequence[PairResult]
) -> NotConnectedError:
    """Names the groups, what the pairs between them lack, and which pairs would join them."""
    groups = sorted(groups, key=lambda group: (root not in group, sorted(group)))
    between = [p for p in pairs if not any(p.a in g and p.b in g for g in groups)]
    named = "; ".join("{" + ", ".join(sorted(g)) + "}" for g in groups)
    lines = [f"the sensors fall into {len(groups)} groups that nothing links: {named}"]
    for pair in between:
        shared = f"{pair.shared} shared exposures" if pair.shared else "no shared exposure"
        why = f": {pair.reason}" if pair.shared else ""
        lines.append(f"  {pair.a} - {pair.b}: {shared}{why}")
    joins = _joins(groups, between)
    wanted = " and ".join(f"{a} and {b}" for a, b in joins) or "a sensor of each group"
    lines.append(
        f"record the board where {wanted} see it at the same time, in at least 5 poses with "
        "different tilts (`rigcal plan` says where); or check these sensors' topics and target"
    )
    return NotConnectedError("\n".join(lines), [sorted(g) for g in groups], joins)


def _joins(groups: Sequence[set[str]], between: Sequence[PairResult]) -> list[tuple[str, str]]:
    """The fewest pairs that would join all groups: those that share most exposures already."""
    graph: nx.Graph[int] = nx.Graph()
    joins = []
    member = {sensor: i for i, group in enumerate(groups) for sensor in group}
    for pair in sorted((p for p in between if p.can_join), key=lambda p: -p.shared):
        a, b = member[pair.a], member[pair.b]
        if not (graph.has_node(a) and graph.has_node(b) and nx.has_path(graph, a, b)):
            graph.add_edge(a, b)
            joins.append((pair.a, pair.b))
    return joins
