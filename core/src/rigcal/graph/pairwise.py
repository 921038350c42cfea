"""The transform between two sensors from the exposures they share."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rigcal.geometry.se3 import Array
from rigcal.graph.consensus import find_consensus
from rigcal.graph.correspondence import Correspondences, correspondences
from rigcal.graph.degeneracy import cause, in_common, open_direction
from rigcal.graph.refinement import Fit, inliers
from rigcal.graph.relate import why_undetermined
from rigcal.graph.scale import scale_that_agrees, tests_size
from rigcal.observation import LineGeometry, Observation, PlaneGeometry, PointGeometry
from rigcal.targets.target import Target

# Of the exposures beyond a minimal sample, this share must agree too: twice what agrees by chance
# among boards that have nothing to do with each other.
_LEAST_SHARE, _LEAST_SHARE_OF_LINES, _LEAST_SHARE_OF_POINTS = 0.1, 0.15, 0.35
# With exposures that do not belong together, fewer than this share of the inliers may agree.
_CHANCE, _SHIFTS = 0.5, 4
_DOUBTFUL_SHARE = 0.7


@dataclass(frozen=True, eq=False)
class PairResult:
    """`T_a_b` (4, 4) with covariance (6, 6), right perturbation, or why there is none.

    `inliers` gives, per exposure, the candidates of a and of b that agree. `rms_m` is their
    distance, `model_error_m` the part of it (standard deviation) that the sensors' noise does not
    explain; the covariance holds both. `tests_size`: whether the pair holds the target's dimensions
    in the rig file against measured ranges; `target_scale`: the factor on them with which the pair
    would agree, if there is one and it does not agree otherwise.

    `is_loose`: `T_a_b` is only one of many that explain the exposures (`reason` says why).
    `fit_if_open` is one that the exposures agree on but leave open, by which the pair failed.
    `can_join`: whether what the two sensors see of a board could determine a transform at all.
    """

    a: str
    b: str
    shared: int
    T_a_b: Array | None = None
    covariance: Array | None = None
    inliers: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    rms_m: float = float("nan")
    model_error_m: float = 0.0
    reason: str = ""
    tests_size: bool = False
    target_scale: float | None = None
    is_loose: bool = False
    fit_if_open: Fit | None = None
    can_join: bool = True


def calibrate_pair(
    pairs: Sequence[tuple[Observation, Observation]],
    target: Target,
    rng: np.random.Generator,
    names: tuple[str, str],
) -> PairResult:
    """The transform `T_a_b` that most exposures agree on.

    `pairs` holds the observations of a and b of every exposure in which both have candidates.
    A result without `T_a_b` says why in `reason`.
    """
    result = PairResult(*names, len(pairs))
    c = correspondences(pairs, target)
    if c is None:
        return replace(result, reason=why_undetermined(pairs))
    needed = _needed(c)
    consensus = find_consensus(c, rng)
    fit = consensus.fit
    if fit is None:
        reason = _no_hypothesis(c, consensus.hypotheses)
        return _disagreement(c, needed, rng, replace(result, reason=reason))
    count = len(fit.keep)
    reason = f"only {count} of {len(pairs)} exposures agree on a transform ({needed} needed)"
    if count < needed:
        reason += _because(c)
        return _disagreement(c, needed, rng, replace(result, reason=reason))
    if count < _DOUBTFUL_SHARE * len(c.starts):
        more = math.ceil(1.3 * count)
        doubt = _disagreement(c, more, rng, replace(result, reason=reason))
        if doubt.target_scale is not None:
            return doubt
    if reason := open_direction(c, fit):
        reason = f"{count} exposures agree, but {reason}"
        return replace(result, reason=reason, fit_if_open=fit)
    if reason := _chance(pairs, target, c, fit):
        return replace(result, reason=f"{count} exposures agree, but {reason}")
    distances = c.relation.distances(fit.T_a_b[None])[0, fit.keep]
    return replace(
        result,
        T_a_b=fit.T_a_b,
        covariance=np.asarray(np.linalg.inv(fit.information), np.float64),
        inliers={pairs[c.exposure[h]][0].exposure: (int(c.a[h]), int(c.b[h])) for h in fit.keep},
        rms_m=float(np.sqrt(np.mean(distances**2))),
        model_error_m=float(np.sqrt(np.mean(fit.model_error**2))),
        tests_size=tests_size(c),
    )


def _needed(c: Correspondences) -> int:
    """How many exposures must agree: more than a minimal sample, which agrees with itself."""
    exposures, minimal = len(c.starts), c.relation.minimal
    if minimal == 1:
        return 1 + math.ceil(_LEAST_SHARE * (exposures - 1))
    share = _LEAST_SHARE
    if c.pairing[1] is LineGeometry:
        share = _LEAST_SHARE_OF_LINES
    elif c.pairing == (PlaneGeometry, PointGeometry):
        share = _LEAST_SHARE_OF_POINTS
    return minimal + max(2, math.ceil(share * (exposures - minimal)))


def _chance(
    pairs: Sequence[tuple[Observation, Observation]], target: Target, c: Correspondences, fit: Fit
) -> str:
    """Why the agreement proves nothing: exposures that do not belong together agree as well.

    A wall that both sensors take for the board does so; fiducials are never something else.
    """
    count, agree, most = len(pairs), 0, min(_SHIFTS, len(pairs) - 1)
    if c.relation.minimal == 1:
        return ""
    for shift in range(1, most + 1):
        by = max(1, shift * count // (most + 1))
        mixed = [(pairs[k][0], pairs[(k + by) % count][1]) for k in range(count)]
        other = correspondences(mixed, target)
        agree += 0 if other is None else len(inliers(other, fit.T_a_b, fit.model_error))
    if agree < _CHANCE * most * len(fit.keep):
        return ""
    return (
        f"of {most * count} pairs of exposures that do not belong together {agree} do as well: the "
        "board hardly moved, or both sensors take the background for it; move the board further"
    )


def _no_hypothesis(c: Correspondences, hypotheses: int) -> str:
    exposures, minimal = len(c.starts), c.relation.minimal
    if exposures < minimal:
        return f"{exposures} shared exposures are too few: {minimal} are the minimum, 10 are good"
    if not hypotheses:
        return f"no {minimal} shared exposures fix it: {cause(c, np.arange(len(c.exposure)))}"
    return f"no transform explains {minimal} of {exposures} exposures{_because(c)}"


def _because(c: Correspondences) -> str:
    """What all exposures have in common, if that is why none of them agree."""
    reason = in_common(c, np.arange(len(c.exposure)))
    return f": {reason}" if reason else ""


def _disagreement(
    c: Correspondences, needed: int, rng: np.random.Generator, result: PairResult
) -> PairResult:
    """The failed result, with the scale of the target that would mend it."""
    found = scale_that_agrees(c, needed, rng) if tests_size(c) else None
    if found is None:
        return result
    scale, count = found
    reason = f"{result.reason}; {count} would if the target were {scale:.2f} times as large"
    return replace(result, reason=reason, tests_size=True, target_scale=scale)
