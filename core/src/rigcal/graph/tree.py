"""First poses of all sensors: the maximum spanning tree of the pairs from the root."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

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
    graph: nx.Graph[str] = nx.Graph()
    graph.add_nodes_from(sensors)
    for name in given:
        if name != root:
            graph.add_edge(root, name, weight=0.0, pair=None)
    for pair in pairs:
        if pair.T_a_b is not None and not graph.has_edge(pair.a, pair.b):
            graph.add_edge(pair.a, pair.b, weight=_variance(pair), pair=pair)
    components = list(nx.connected_components(graph))
    if len(components) > 1:
        raise NotConnectedError(_explain(root, components, pairs))
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


def _explain(root: str, components: list[set[str]], pairs: Sequence[PairResult]) -> str:
    """Names the components, and what the pairs between them lack."""
    components = sorted((c for c in components), key=lambda c: (root not in c, sorted(c)))
    groups = "; ".join("{" + ", ".join(sorted(c)) + "}" for c in components)
    lines = [f"the sensors fall into {len(components)} groups that nothing links: {groups}"]
    member = {name: i for i, c in enumerate(components) for name in c}
    for pair in pairs:
        if member[pair.a] != member[pair.b]:
            shared = f"{pair.shared} shared exposures" if pair.shared else "no shared exposure"
            why = f": {pair.reason}" if pair.shared else ""
            lines.append(f"  {pair.a} - {pair.b}: {shared}{why}")
    lines.append(
        "record the board where a sensor of one group and a sensor of another see it at the same "
        "time, in at least 5 poses with different tilts; or check these sensors' topics and target"
    )
    return "\n".join(lines)
