"""A transform between two sensors whose shared exposures do not fix it, or do not prove it.

It is one of many that explain the exposures. It says where the sensors may be, so that what the
data leave open can be named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.correspondence import MODEL_ERROR_M, Correspondences, correspondences
from rigcal.graph.degeneracy import OPEN, open_direction
from rigcal.graph.pairwise import PairResult
from rigcal.graph.refinement import Fit, refine, step
from rigcal.observation import Observation
from rigcal.targets.target import Target

_STARTS, _STEPS = 40, 15
# Information that keeps steps short where noise alone would lead far away.
_DAMPING = 10 / OPEN**2
# Of the exposures, this share must be explained: sensors that contradict each other are not linked.
_LEAST_SHARE = 0.7


def loosely(
    pairs: Sequence[tuple[Observation, Observation]],
    target: Target,
    rng: np.random.Generator,
    failed: PairResult,
) -> PairResult:
    """The failed pair with one of many transforms that explain most of its exposures.

    Unchanged if there is none, or if it failed for another reason than that they leave it open.
    `pairs` as for `calibrate_pair`.
    """
    c = correspondences(pairs, target)
    if c is None:
        return failed
    best = failed.fit_if_open or _best_of_starts(c, rng)
    if not _explains(c, best) or not open_direction(c, best):
        return failed
    return replace(
        failed,
        T_a_b=best.T_a_b,
        covariance=_wide(best),
        inliers={pairs[c.exposure[h]][0].exposure: (int(c.a[h]), int(c.b[h])) for h in best.keep},
        is_loose=True,
    )


def _best_of_starts(c: Correspondences, rng: np.random.Generator) -> Fit:
    fits = [refine(c, _settled(c, T), MODEL_ERROR_M, _DAMPING) for T in _starts(c, rng)]
    return min(fits, key=lambda fit: (-len(fit.keep), float(np.sum(fit.model_error))))


def _explains(c: Correspondences, fit: Fit) -> bool:
    return len(fit.keep) >= _LEAST_SHARE * len(c.starts)


def _wide(fit: Fit) -> Array:
    """(6, 6) covariance, wider than that of any pair that is not loose."""
    values, vectors = np.linalg.eigh(fit.information)
    result: Array = (vectors / np.maximum(values, 1e-6)) @ vectors.T + np.eye(6)
    return result


def _settled(c: Correspondences, T: Array) -> Array:
    """Steps on the best-ranked candidates of all exposures."""
    error = np.full(len(c.relation.components), MODEL_ERROR_M)
    for _ in range(_STEPS):
        T = step(c, T, c.starts, error, _DAMPING)
    return T


def _starts(c: Correspondences, rng: np.random.Generator) -> Array:
    """Rotations at random (uniform on SO(3)), with the shift that joins the places looked at."""
    R = se3.rotation_from_quaternion(rng.normal(size=(_STARTS, 4)))
    t = c.center_a[c.starts].mean(axis=0) - R @ c.center_b[c.starts].mean(axis=0)
    return se3.transform(R, t)
