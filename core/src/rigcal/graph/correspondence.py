"""Which candidates of two sensors may show the same board, as flat arrays.

A correspondence is one candidate of each sensor in one exposure. Several of one exposure are rival
hypotheses: at most one is right.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry.se3 import Array
from rigcal.graph.board import center_of
from rigcal.graph.relate import Pairing, pairing_of, relate
from rigcal.graph.relation import Index, Relation
from rigcal.observation import Geometry, Observation, PoseGeometry
from rigcal.targets.target import Target

MODEL_ERROR_M = 0.02
"""The most by which sensors may disagree beyond their noise: biased ranges, bent boards, lens
models. How much it is in fact is estimated from the data."""


@dataclass(frozen=True, eq=False)
class Correspondences:
    """H correspondences, sorted by exposure, of one pairing of geometries.

    exposure (H,), a (H,), b (H,): indices of the exposure and of the candidates. center_a,
    center_b (H, 3): where on the board each sensor looked; reach (H,): how far apart they may be,
    m. size_m: the diagonal of the board.
    """

    exposure: NDArray[np.int64]
    a: NDArray[np.int64]
    b: NDArray[np.int64]
    center_a: Array
    center_b: Array
    reach: Array
    size_m: float
    pairing: Pairing
    relation: Relation

    @property
    def starts(self) -> Index:
        """(E,) the first correspondence of every exposure."""
        return np.flatnonzero(np.diff(self.exposure, prepend=-1))

    def apart(self, T_a_b: Array) -> Array:
        """(M, H) distances (m) of the centres under transforms (M, 4, 4)."""
        center = self.center_b @ np.swapaxes(T_a_b[:, :3, :3], -1, -2) + T_a_b[:, None, :3, 3]
        result: Array = np.linalg.norm(center - self.center_a, axis=-1)
        return result


def correspondences(
    pairs: Sequence[tuple[Observation, Observation]], target: Target
) -> Correspondences | None:
    """All candidate pairs of the exposures that a and b share; None if no pair determines.

    Where the candidates differ in kind, those of the commonest pairing are taken.
    """
    found: dict[Pairing, list[tuple[int, int, int]]] = defaultdict(list)
    for k, (first, second) in enumerate(pairs):
        for i, ca in enumerate(first.candidates):
            for j, cb in enumerate(second.candidates):
                if (pairing := pairing_of(ca.geometry, cb.geometry)) is not None:
                    found[pairing].append((k, i, j))
    if not found:
        return None
    pairing = max(found, key=lambda p: len({k for k, _, _ in found[p]}))
    exposure, a, b = np.array(found[pairing]).T
    seen_a = [pairs[k][0].candidates[i].geometry for k, i in zip(exposure, a, strict=True)]
    seen_b = [pairs[k][1].candidates[j].geometry for k, j in zip(exposure, b, strict=True)]
    relation = relate(pairing, seen_a, seen_b, target)
    diagonal = float(np.hypot(*target.size))
    return Correspondences(
        exposure,
        a,
        b,
        np.array([center_of(g) for g in seen_a]),
        np.array([center_of(g) for g in seen_b]),
        _reach(seen_a, relation.sigma, diagonal),
        diagonal,
        pairing,
        relation,
    )


def _reach(seen_a: Sequence[Geometry], sigma: Array, diagonal: float) -> Array:
    """(H,) m; a line or a hand-covered plane may lie anywhere on the board."""
    share = np.array([0.55 if isinstance(g, PoseGeometry) else 0.8 for g in seen_a])
    result: Array = share * diagonal + 3 * np.hypot(sigma, MODEL_ERROR_M)
    return result
