"""Pairs of sensors that close loops check each other: which of them cannot be right."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import networkx as nx
import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.correspondence import MODEL_ERROR_M
from rigcal.graph.pairwise import PairResult

# A loop of right pairs fails with this probability.
_SIGNIFICANCE = 1e-4
# What all exposures share, such as a biased range, no covariance of a pair holds: the most by
# which sensors may disagree is three of these (rad at a metre, and m).
_SYSTEMATIC = np.full(6, MODEL_ERROR_M / 3)
_MOST_BAD = 3
_MOST_SUSPECTS = 40


@dataclass(frozen=True, eq=False)
class Loop:
    """Sensors s_0, s_1, ..., back to s_0, and how far the product of their pairs is from identity.

    `error` (6,) is [rotation, translation] in the frame of s_0, `chi2` its square by covariance.
    """

    sensors: tuple[str, ...]
    error: Array
    chi2: float

    @property
    def edges(self) -> frozenset[frozenset[str]]:
        """The pairs that the loop consists of."""
        s = self.sensors
        return frozenset(frozenset(p) for p in zip(s, (*s[1:], s[0]), strict=True))

    def __str__(self) -> str:
        degrees, mm = np.degrees(np.linalg.norm(self.error[:3])), np.linalg.norm(self.error[3:])
        path = " - ".join((*self.sensors, self.sensors[0]))
        return f"{path} closes with {degrees:.2g} deg and {1e3 * mm:.2g} mm"


def check_loops(pairs: Sequence[PairResult]) -> tuple[tuple[PairResult, ...], tuple[str, ...]]:
    """The pairs, those that spoil loops without their transform and with the reason; and warnings.

    A loop fails if its error is beyond what the covariances of its pairs allow (chi-square). Bad
    are the fewest pairs without which no loop fails. Pairs of a loop that holds are not suspected.
    Where several sets of pairs would do, nothing tells which is bad: a warning names the loops.
    """
    solved = {frozenset((p.a, p.b)): p for p in pairs if p.T_a_b is not None}
    failing, cleared = _judge(_loops(solved), solved)
    bad = _culprits([loop.edges - cleared for loop in failing])
    if bad is None:
        return tuple(pairs), tuple(
            f"loop {loop}: one of its pairs is wrong, and no other loop tells which"
            for loop in failing
        )
    return tuple(_without_transform(p, failing) if _name(p) in bad else p for p in pairs), ()


def _name(pair: PairResult) -> frozenset[str]:
    return frozenset((pair.a, pair.b))


def _without_transform(pair: PairResult, failing: Sequence[Loop]) -> PairResult:
    own = [loop for loop in failing if _name(pair) in loop.edges]
    worst = max(own, key=lambda loop: loop.chi2)
    reason = (
        f"their transform contradicts other pairs: loop {worst}"
        f"{f', and {len(own) - 1} more loops fail' if len(own) > 1 else ''}; it is not used"
    )
    return replace(pair, T_a_b=None, covariance=None, inliers={}, reason=reason)


def _loops(solved: Mapping[frozenset[str], PairResult]) -> list[Loop]:
    """All loops of three pairs, and the longer ones that no sum of shorter ones makes."""
    graph: nx.Graph[str] = nx.Graph()
    graph.add_edges_from((p.a, p.b) for p in solved.values())
    sensors = sorted(graph)
    rings: list[tuple[str, ...]] = [
        trio
        for trio in itertools.combinations(sensors, 3)
        if all(graph.has_edge(x, y) for x, y in itertools.combinations(trio, 2))
    ]
    rings += [tuple(ring) for ring in nx.minimum_cycle_basis(graph) if len(ring) > 3]
    return [_close(ring, solved) for ring in rings]


def _close(sensors: tuple[str, ...], solved: Mapping[frozenset[str], PairResult]) -> Loop:
    """The loop's error, its covariance summed to first order in the frame of the first sensor."""
    T, C = np.eye(4), np.diag(_SYSTEMATIC**2)
    for x, y in zip(sensors, (*sensors[1:], sensors[0]), strict=True):
        pair = solved[frozenset((x, y))]
        assert pair.T_a_b is not None
        assert pair.covariance is not None
        after = T @ (pair.T_a_b if pair.a == x else se3.inverse(pair.T_a_b))
        # The covariance is over motions in b, wherever the loop meets that sensor.
        A = se3.adjoint(after if pair.a == x else T)
        C, T = C + A @ pair.covariance @ A.T, after
    error = se3.log(T)
    return Loop(sensors, error, float(error @ np.linalg.solve(C, error)))


def _judge(
    loops: Sequence[Loop], solved: Mapping[frozenset[str], PairResult]
) -> tuple[list[Loop], frozenset[frozenset[str]]]:
    """The loops that fail, and the pairs that are not suspected: those of loops that hold, unless
    that would leave a failing loop without a suspect.
    """
    from scipy.stats import chi2 as law

    limit = float(law.isf(_SIGNIFICANCE, 6))
    failing = [loop for loop in loops if loop.chi2 > limit]
    holds = frozenset(edge for loop in loops if loop.chi2 <= limit for edge in loop.edges)
    if any(loop.edges <= holds for loop in failing):
        return failing, frozenset()
    return failing, holds


def _culprits(loops: Sequence[frozenset[frozenset[str]]]) -> frozenset[frozenset[str]] | None:
    """The one smallest set of pairs with a pair of every loop; None if there are several."""
    suspects = sorted(frozenset().union(*loops), key=sorted)
    if len(suspects) > _MOST_SUSPECTS:
        return None
    for size in range(_MOST_BAD + 1):
        sets = [
            frozenset(s)
            for s in itertools.combinations(suspects, size)
            if all(loop.intersection(s) for loop in loops)
        ]
        if sets:
            return sets[0] if len(sets) == 1 else None
    return None
