"""The transform between two sensors from the exposures they share, by RANSAC over candidates."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph import solvers
from rigcal.graph.correspondence import Correspondences, correspondences, plane_of
from rigcal.graph.scale import scale_that_agrees
from rigcal.observation import (
    LineGeometry,
    Observation,
    PlaneGeometry,
    PointGeometry,
    PoseGeometry,
)
from rigcal.targets.target import Target

GATE_SIGMAS = 3.0
# Of the exposures beyond a minimal sample, this share must agree too. Many a scan that misses the
# board has a line of its length; planes of its size and fiducials are rarely something else.
_LEAST_SHARE, _LEAST_SHARE_OF_LINES = 0.4, 0.2
_DOUBTFUL_SHARE = 0.7
_BATCH, _MOST_BATCHES, _CONFIDENCE = 60, 12, 0.999
# Beyond these a pair leaves its transform open (standard deviations, rad and m).
_OPEN = np.array([np.radians(5.0)] * 3 + [0.25] * 3)
_AXES = ("rotation about x", "rotation about y", "rotation about z", "x", "y", "z")


@dataclass(frozen=True, eq=False)
class PairResult:
    """`T_a_b` (4, 4) with covariance (6, 6), right perturbation, or why there is none.

    `inliers` gives, per exposure, the candidates of a and of b that agree. `rms_m` is their
    distance. `tests_size`: whether the pair holds the target's dimensions in the rig file against
    measured ranges; `target_scale`: the factor on them with which the pair would agree, if there
    is one and it does not agree otherwise.
    """

    a: str
    b: str
    shared: int
    T_a_b: Array | None = None
    covariance: Array | None = None
    inliers: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    rms_m: float = float("nan")
    reason: str = ""
    tests_size: bool = False
    target_scale: float | None = None


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
    a, b = names
    shared = len(pairs)
    c = correspondences(pairs, target)
    if c is None:
        kinds = sorted({type(o.candidates[0].geometry).__name__ for p in pairs for o in p})
        reason = f"{' and '.join(kinds)} do not determine a transform" if pairs else "no exposure"
        return PairResult(a, b, shared, reason=reason)
    needed, tests_size = _needed(c, pairs), _is_pose_plane(c, pairs)
    T, reason = _ransac(c, pairs, rng)
    if T is None:
        return _disagreement(c, pairs, needed, rng, PairResult(a, b, shared, reason=reason))
    T, keep, information = _refine(c, T)
    reason = f"only {len(keep)} of {shared} exposures agree on a transform ({needed} needed)"
    if len(keep) < needed:
        return _disagreement(c, pairs, needed, rng, PairResult(a, b, shared, reason=reason))
    if len(keep) < _DOUBTFUL_SHARE * len(np.unique(c.exposure)):
        more = math.ceil(1.3 * len(keep))
        doubt = _disagreement(c, pairs, more, rng, PairResult(a, b, shared, reason=reason))
        if doubt.target_scale is not None:
            return doubt
    covariance, reason = _covariance(information)
    if covariance is None:
        return PairResult(a, b, shared, reason=f"{len(keep)} exposures agree, but {reason}")
    inliers = {pairs[c.exposure[h]][0].exposure: (int(c.a[h]), int(c.b[h])) for h in keep}
    rms = float(np.sqrt(np.mean(c.distances(T[None])[0][0, keep] ** 2)))
    return PairResult(a, b, shared, T, covariance, inliers, rms, tests_size=tests_size)


def _needed(c: Correspondences, pairs: Sequence[tuple[Observation, Observation]]) -> int:
    """How many exposures must agree: more than a minimal sample, which agrees with itself."""
    exposures = len(np.unique(c.exposure))
    first, second = (pairs[c.exposure[0]][s].candidates[0].geometry for s in (0, 1))
    if isinstance(first, PoseGeometry) and isinstance(second, PoseGeometry):
        return 1 + math.ceil(_LEAST_SHARE * (exposures - 1))
    share = _LEAST_SHARE_OF_LINES if isinstance(second, LineGeometry) else _LEAST_SHARE
    return 3 + max(2, math.ceil(share * (exposures - 3)))


def _disagreement(
    c: Correspondences,
    pairs: Sequence[tuple[Observation, Observation]],
    needed: int,
    rng: np.random.Generator,
    result: PairResult,
) -> PairResult:
    """The failed result, with the scale of the target that would mend it."""
    if not _is_pose_plane(c, pairs):
        return result
    n_b, d_b = _planes_of_b(c, pairs, np.arange(len(c.exposure)))
    found = scale_that_agrees(c, n_b, d_b, needed, rng)
    if found is None:
        return result
    scale, count = found
    reason = f"{result.reason}; {count} would if the target were {scale:.3g} times as large"
    return replace(result, reason=reason, tests_size=True, target_scale=scale)


def _is_pose_plane(c: Correspondences, pairs: Sequence[tuple[Observation, Observation]]) -> bool:
    first, second = (pairs[c.exposure[0]][s].candidates[0].geometry for s in (0, 1))
    return isinstance(first, PoseGeometry) and isinstance(second, PlaneGeometry)


def _planes_of_b(
    c: Correspondences,
    pairs: Sequence[tuple[Observation, Observation]],
    h: NDArray[np.int64],
) -> tuple[Array, Array]:
    """Normals (..., 3) and distances (...) of the planes that b saw in correspondences h (...)."""
    planes = [plane_of(pairs[c.exposure[i]][1].candidates[c.b[i]].geometry) for i in h.flat]
    n_b = np.array([p[0] for p in planes]).reshape(*h.shape, 3)
    return n_b, np.array([p[1] for p in planes]).reshape(h.shape)


def _scores(c: Correspondences, T: Array) -> tuple[Array, Array]:
    """MSAC score (M,) of transforms, and of every correspondence (M, H), 0 for an outlier."""
    distance, apart = c.distances(T)
    score = np.maximum(0.0, 1 - (distance / (GATE_SIGMAS * c.sigma)) ** 2)
    score[apart > c.reach] = 0.0
    starts = np.flatnonzero(np.diff(c.exposure, prepend=-1))
    return np.maximum.reduceat(score, starts, axis=1).sum(axis=1), score


def _ransac(
    c: Correspondences,
    pairs: Sequence[tuple[Observation, Observation]],
    rng: np.random.Generator,
) -> tuple[Array | None, str]:
    """The best of all hypotheses; stops when a better one is unlikely (Fischler, Bolles 1981).

    Without one, says why.
    """
    starts = np.flatnonzero(np.diff(c.exposure, prepend=-1))
    exposures = len(starts)
    best, best_score, hypotheses = None, 0.0, 0
    for batch in range(1, _MOST_BATCHES + 1):
        T = _hypotheses(c, pairs, starts, rng)
        hypotheses += len(T)
        for part in np.array_split(T, max(1, len(T) // 100)):
            scores, each = _scores(c, part)
            if len(scores) and scores.max() > best_score:
                top = int(scores.argmax())
                best, best_score = part[top], float(scores[top])
                share = np.count_nonzero(each[top]) / len(c.exposure)
        if best is not None:
            misses = (1 - share**3) ** (batch * _BATCH)
            if misses < 1 - _CONFIDENCE:
                break
        if exposures < 3:
            break
    if best is not None:
        return best, ""
    if exposures < 3 and not hypotheses:
        return None, f"{exposures} shared exposures are too few: 3 are the minimum, 10 are good"
    if not hypotheses:
        return None, "the boards are parallel, or too near to it, in every three shared exposures"
    return None, f"no transform explains 3 of {exposures} exposures"


def _hypotheses(
    c: Correspondences,
    pairs: Sequence[tuple[Observation, Observation]],
    starts: NDArray[np.intp],
    rng: np.random.Generator,
) -> Array:
    """(M, 4, 4) transforms of one batch of minimal samples."""
    first, second = (pairs[c.exposure[0]][s].candidates[0].geometry for s in (0, 1))
    if isinstance(first, PoseGeometry) and isinstance(second, PoseGeometry):
        h = rng.permutation(len(c.exposure))[:300]
        return np.stack([_pose_from_pose(c, pairs, i) for i in h])
    if len(starts) < 3:
        return np.zeros((0, 4, 4))
    sample = _sample(c, starts, rng)
    if isinstance(first, PointGeometry) or isinstance(second, PointGeometry):
        return solvers.from_points(c.p_a[sample, 0], c.p_b[sample, 0])
    if isinstance(second, LineGeometry):
        v = c.p_b[sample, 1] - c.p_b[sample, 0]
        v /= np.linalg.norm(v, axis=-1, keepdims=True)
        rotations = solvers.random_rotations(solvers.STARTS, rng)
        T = solvers.from_planes_and_lines(
            c.n_a[sample], c.d_a[sample], c.p_b[sample, 0], v, rotations
        )
        return _plausible(c, T)
    n_b, d_b = _planes_of_b(c, pairs, sample)
    return solvers.from_planes(c.n_a[sample], c.d_a[sample], n_b, d_b)


def _pose_from_pose(
    c: Correspondences, pairs: Sequence[tuple[Observation, Observation]], h: int
) -> Array:
    a, b = (pairs[c.exposure[h]][s].candidates[i].geometry for s, i in ((0, c.a[h]), (1, c.b[h])))
    assert isinstance(a, PoseGeometry)
    assert isinstance(b, PoseGeometry)
    result: Array = a.T_s_t @ se3.inverse(b.T_s_t)
    return result


def _sample(
    c: Correspondences, starts: NDArray[np.intp], rng: np.random.Generator
) -> NDArray[np.int64]:
    """(_BATCH, 3) correspondences of three different exposures, higher ranked ones more often."""
    weight = 0.5 ** (c.a + c.b).astype(np.float64)
    noise = np.log(weight) + rng.gumbel(size=(_BATCH, len(weight)))
    ends = np.append(starts[1:], len(weight))
    exposures = rng.permuted(np.tile(np.arange(len(starts)), (_BATCH, 1)), axis=1)[:, :3]
    chosen = np.empty((_BATCH, 3), dtype=np.int64)
    for s in range(_BATCH):
        for i, k in enumerate(exposures[s]):
            chosen[s, i] = starts[k] + int(noise[s, starts[k] : ends[k]].argmax())
    return chosen


def _plausible(c: Correspondences, T: Array) -> Array:
    """Drops roots that put the line's board far from the plane's: most false roots do."""
    if not len(T):
        return T
    apart = np.linalg.norm(
        np.einsum("mij,hj->mhi", T[:, :3, :3], c.center_b) + T[:, None, :3, 3] - c.center_a, axis=-1
    )
    result: Array = T[np.count_nonzero(apart < c.reach, axis=1) >= 3]
    return result


def _refine(c: Correspondences, T: Array) -> tuple[Array, NDArray[np.intp], Array]:
    """Gauss-Newton on the inliers until they stay the same; returns T, inliers, information."""
    keep = _inliers(c, T)
    for _ in range(10):
        for _ in range(5):
            r, J = c.rows(T, keep)
            step = np.asarray(np.linalg.lstsq(J, r, rcond=1e-12)[0], dtype=np.float64)
            T = T @ se3.exp(-step)
        before, keep = keep, _inliers(c, T)
        if np.array_equal(before, keep):
            break
    _, J = c.rows(T, keep)
    return T, keep, J.T @ J


def _inliers(c: Correspondences, T: Array) -> NDArray[np.intp]:
    """The best correspondence of every exposure that has one within the gate."""
    score = _scores(c, T[None])[1][0]
    starts = np.flatnonzero(np.diff(c.exposure, prepend=-1))
    parts = np.split(np.arange(len(score)), starts[1:])
    best = np.array([part[score[part].argmax()] for part in parts])
    result: NDArray[np.intp] = best[score[best] > 0]
    return result


def _covariance(information: Array) -> tuple[Array | None, str]:
    """Covariance, or in words which direction the exposures leave open."""
    # In units of what counts as open, so that rotation and translation compare.
    scaled = information * np.outer(_OPEN, _OPEN)
    values, vectors = np.linalg.eigh(scaled)
    if values[0] < 1.0:
        axis = _AXES[int(np.abs(vectors[:, 0]).argmax())]
        cause = "boards with other orientations are needed (parallel boards fix no more)"
        return None, f"they leave {axis} of the second sensor open: {cause}"
    covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
    return covariance, ""
