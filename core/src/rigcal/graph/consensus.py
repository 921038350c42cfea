"""RANSAC over candidates: the transform that explains most exposures, and explains them best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.geometry.se3 import Array
from rigcal.graph.correspondence import MODEL_ERROR_M, Correspondences
from rigcal.graph.refinement import Fit, refine
from rigcal.graph.relation import Index

# Model errors (m) that a hypothesis is tried with.
_MODEL_ERRORS = MODEL_ERROR_M * np.array([0.0, 0.1, 0.25, 0.5, 1.0])
_BATCH, _MOST_SAMPLES, _CONFIDENCE = 100, 3000, 0.999
_CHUNK = 100


@dataclass(frozen=True, eq=False)
class Consensus:
    """The best fit, if any, and how many hypotheses the samples gave."""

    fit: Fit | None
    hypotheses: int


@dataclass(frozen=True, eq=False)
class _Score:
    """The log-likelihood that a transform gains over all being outliers.

    `explained` (H,) bool: the correspondences that add to it, at `model_error` (m).
    """

    value: float
    model_error: float
    explained: Array


def find_consensus(c: Correspondences, rng: np.random.Generator) -> Consensus:
    """The hypothesis with the highest score, refined.

    Samples are drawn until a better one is unlikely (M. Fischler, R. Bolles 1981; here with the
    chance that a draw picks the right candidates). Every hypothesis that leads is refined on its
    inliers at once (O. Chum, J. Matas, J. Kittler, "Locally optimized RANSAC", 2003), so that the
    noise of a minimal sample does not count.
    """
    table, weight = _rivals(c)
    best: Fit | None = None
    lead = _Score(0.0, 0.0, np.zeros(len(c.exposure)))
    samples = hypotheses = 0
    while samples < _MOST_SAMPLES:
        T = c.relation.solve(_draw(table, weight, c.relation.minimal, rng))
        T = T[np.count_nonzero(c.apart(T) < c.reach, axis=1) >= c.relation.minimal]
        samples, hypotheses = samples + _BATCH, hypotheses + len(T)
        for part in np.array_split(T, max(1, len(T) // _CHUNK)):
            scores, at = _scores(c, part)
            if len(part) and scores.max() > lead.value:
                top = int(scores.argmax())
                fit = refine(c, part[top], float(at[top]))
                score = _score(c, fit.T_a_b)
                if score.value > lead.value:
                    best, lead = fit, score
        if _chance_of_better(c, table, weight, lead, samples) < 1 - _CONFIDENCE:
            break
    return Consensus(best, hypotheses)


def _rivals(c: Correspondences) -> tuple[Index, Array]:
    """(E, C) correspondences of every exposure, and the chance (E, C) that a draw picks each.

    Higher ranked candidates are drawn more often. Shorter rows are filled with chance 0.
    """
    starts = c.starts
    row = np.repeat(np.arange(len(starts)), np.diff(np.append(starts, len(c.exposure))))
    column = np.arange(len(c.exposure)) - starts[row]
    table = np.zeros((len(starts), column.max() + 1), dtype=np.intp)
    weight = np.zeros(table.shape)
    table[row, column] = np.arange(len(c.exposure))
    weight[row, column] = 0.5 ** (c.a + c.b)
    return table, weight / weight.sum(axis=1, keepdims=True)


def _draw(table: Index, weight: Array, size: int, rng: np.random.Generator) -> Index:
    """(_BATCH, size) correspondences of different exposures; none if there are too few."""
    if len(table) < size:
        return np.zeros((0, size), dtype=np.intp)
    exposures = rng.random((_BATCH, len(table))).argsort(axis=1)[:, :size]
    pick = rng.random((_BATCH, size, 1))
    column = np.count_nonzero(weight.cumsum(axis=1)[exposures] < pick * (1 - 1e-9), axis=-1)
    result: Index = table[exposures, column]
    return result


def _scores(c: Correspondences, T: Array) -> tuple[Array, Array]:
    """Scores (M,) of transforms (M, 4, 4), and the model errors (M,) that give them.

    Per exposure, the log-likelihood of its best correspondence under a normal law of the sensors'
    noise and a model error, over that of an outlier anywhere on the board; at least 0 (P. Torr, A.
    Zisserman, "MLESAC", 2000). The model error is the most likely one: so a few centimetres do
    where sensors are no better, and precise ones decide by millimetres.
    """
    squares, starts = _squares(c, T), c.starts
    sums = [
        np.maximum.reduceat(_gains(c, squares, error), starts, axis=1).sum(axis=1)
        for error in _MODEL_ERRORS
    ]
    return np.max(sums, axis=0), _MODEL_ERRORS[np.argmax(sums, axis=0)]


def _score(c: Correspondences, T: Array) -> _Score:
    """The score of one transform."""
    value, at = _scores(c, T[None])
    explained = _gains(c, _squares(c, T[None]), float(at[0]))[0] > 0
    return _Score(float(value[0]), float(at[0]), explained)


def _squares(c: Correspondences, T: Array) -> Array:
    """(M, H) squared distances, m^2; infinite where the sensors looked at different places."""
    result: Array = np.where(c.apart(T) > c.reach, np.inf, c.relation.distances(T) ** 2)
    return result


def _gains(c: Correspondences, squares: Array, model_error: float) -> Array:
    """(M, H) log-likelihood ratios of correspondences, at least 0."""
    variance = c.relation.sigma**2 + model_error**2
    log_ratio = np.log(np.sqrt(2 / np.pi / variance) * c.size_m)
    result: Array = np.maximum(log_ratio - squares / (2 * variance), 0.0)
    return result


def _chance_of_better(
    c: Correspondences, table: Index, weight: Array, lead: _Score, samples: int
) -> float:
    """That so many samples all missed the lead's inliers, (1 - p^m)^samples.

    Where there is no choice of samples, there is nothing better either.
    """
    if len(table) < c.relation.minimal:
        return 0.0
    p = float((weight * lead.explained[table]).sum(axis=1).mean())
    return float((1 - p**c.relation.minimal) ** samples)
