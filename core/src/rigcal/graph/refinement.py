"""From a hypothesis to the best transform: inliers, how far the sensors disagree, covariance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.correspondence import MODEL_ERROR_M, Correspondences
from rigcal.graph.relation import Index

# A true correspondence falls outside with this probability.
_SIGNIFICANCE = 1e-3
# A model error is believed when noise alone would look like it with a smaller probability.
_DOUBT = 0.01
_MOST_ROUNDS, _STEPS = 12, 3
_BISECTIONS = 30


@dataclass(frozen=True, eq=False)
class Fit:
    """`T_a_b`, its inlier correspondences, and the information (6, 6) they hold.

    `model_error` (k,): by how much the sensors disagree beyond their noise (standard deviation of
    every row, m). `from_noise` (6, 6): the part of the information that the noise feigns.
    """

    T_a_b: Array
    keep: Index
    model_error: Array
    information: Array
    from_noise: Array


def refine(c: Correspondences, T: Array, model_error_m: float, damping: Array | None = None) -> Fit:
    """Gauss-Newton on the inliers, in rounds until they stay the same.

    Every row is weighted by the covariance that both sensors' noise gives it at T (errors in
    variables, to first order) and by a model error, a random effect with a variance of its own for
    shifts and for tilts. While inliers are sought, it is estimated robustly (median of chi-square);
    at the end by moments (R. C. Paule, J. Mandel, "Consensus values and weighting factors", 1982),
    where a chi-square test finds any. `damping` (6,) is information that shortens steps.
    """
    model_error = np.full(len(c.relation.components), model_error_m)
    keep = inliers(c, T, model_error)
    for _ in range(_MOST_ROUNDS):
        for _ in range(_STEPS):
            T = step(c, T, keep, model_error, damping)
        model_error = _model_error(c, T, keep)
        before, keep = keep, inliers(c, T, model_error)
        if np.array_equal(before, keep):
            break
    for _ in range(2):
        for _ in range(_STEPS):
            model_error = _model_error(c, T, keep, final=True)
            T = step(c, T, keep, model_error, damping)
        keep = inliers(c, T, model_error)
    _, J, C = c.relation.residuals(T, keep)
    W = np.asarray(np.linalg.inv(C + np.diag(model_error**2)), dtype=np.float64)
    information = np.einsum("hki,hkl,hlj->ij", J, W, J)
    return Fit(T, keep, model_error, information, c.relation.noise_information(T, keep, W))


def inliers(c: Correspondences, T: Array, model_error: Array) -> Index:
    """The best correspondence of every exposure that has one within the gate."""
    from scipy.stats import chi2 as law

    everything = np.arange(len(c.exposure))
    r, _, C = c.relation.residuals(T, everything)
    chi2 = np.einsum("hi,hi->h", r, _solved(C + np.diag(model_error**2), r))
    chi2[c.apart(T[None])[0] > c.reach] = np.inf
    parts = np.split(everything, c.starts[1:])
    best = np.array([part[chi2[part].argmin()] for part in parts])
    result: Index = best[chi2[best] < law.ppf(1 - _SIGNIFICANCE, r.shape[1])]
    return result


def _solved(A: Array, b: Array) -> Array:
    """(n, k) solutions of A (n, k, k) x = b (n, k)."""
    return np.asarray(np.linalg.solve(A, b[..., None])[..., 0], dtype=np.float64)


def step(
    c: Correspondences, T: Array, keep: Index, model_error: Array, damping: Array | None = None
) -> Array:
    """`T_a_b` after a step of Gauss-Newton; in directions without information it stays."""
    r, J, C = c.relation.residuals(T, keep)
    L = np.asarray(np.linalg.cholesky(C + np.diag(model_error**2)), dtype=np.float64)
    rows = np.linalg.solve(L, np.concatenate([J, r[..., None]], axis=-1)).reshape(-1, 7)
    if damping is not None:
        rows = np.vstack([rows, np.diag(np.append(np.sqrt(damping), 0.0))[:6]])
    xi = np.asarray(np.linalg.lstsq(rows[:, :6], rows[:, 6], rcond=1e-12)[0], dtype=np.float64)
    return T @ se3.exp(-xi)


def _model_error(c: Correspondences, T: Array, keep: Index, *, final: bool = False) -> Array:
    """(k,) the model error of every row, m: of each component what makes its chi-square right.

    By its median, or, if `final`, by its mean and only where it is significant.
    """
    result = np.full(len(c.relation.components), MODEL_ERROR_M)
    if not len(keep):
        return result
    r, _, C = c.relation.residuals(T, keep)
    components = np.array(c.relation.components)
    for component in np.unique(components):
        rows = np.flatnonzero(components == component)
        variances, axes = np.linalg.eigh(C[:, rows[:, None], rows])
        squares = np.einsum("hij,hi->hj", axes, r[:, rows]) ** 2
        # The six unknowns take their share of every row.
        dof = max(squares.size - 6 * len(rows) / len(components), 1.0)
        result[rows] = _disagreement(np.maximum(variances, 1e-12), squares, dof, final=final)
    return result


def _disagreement(variances: Array, squares: Array, dof: float, *, final: bool) -> float:
    """The model error (m) that gives chi-square `sum squares / (variances + error^2)`, (n, rows),
    the right median; if `final`, the right mean, or 0 if noise explains it.
    """
    from scipy.stats import chi2 as law

    def chi2(error: float) -> Array:
        each: Array = (squares / (variances + error**2)).sum(axis=1)
        return each

    if not final:
        median = float(law.median(dof / len(squares)))
        return _zero(lambda error: float(np.median(chi2(error))) - median)
    if chi2(0.0).sum() < law.ppf(1 - _DOUBT, dof):
        return 0.0
    return _zero(lambda error: float(chi2(error).sum()) - dof)


def _zero(excess: Callable[[float], float]) -> float:
    """Where a falling function crosses zero between 0 and the largest model error."""
    low, high = 0.0, MODEL_ERROR_M
    if excess(low) <= 0:
        return low
    if excess(high) >= 0:
        return high
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    return high
