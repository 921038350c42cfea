"""Tests of noise: is a sum of squares, or a covariance, what it is said to be?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigcal.geometry.se3 import Array

SIGNIFICANCE = 1e-4
"""A true law fails with this probability; the draws are seeded, so it does so always or never."""

_MOST_CAUTIOUS = 3.0
"""How many times as large as the errors a geometry's standard deviations may be: what a sensor does
not measure (the elevation of a flat radar) has to be stated as unknown."""


def assert_chi_square(value: float, dof: float, what: str, *, only_above: bool = False) -> None:
    """AssertionError unless a sum of squares of `dof` unit normal variables may be `value`."""
    from scipy.stats import chi2

    low, high = chi2.ppf(SIGNIFICANCE / 2, dof), chi2.isf(SIGNIFICANCE / 2, dof)
    scale = float(np.sqrt(value / dof))
    assert value < high, (
        f"{what}: the errors are {scale:.4g} times the configured noise "
        f"(chi-square {value:.1f}, expected below {high:.1f})"
    )
    assert only_above or value > low, (
        f"{what}: the errors are only {scale:.4g} times the configured noise "
        f"(chi-square {value:.1f}, expected above {low:.1f})"
    )


def assert_covariance(square: float, dof: int, what: str, *, only_above: bool = False) -> None:
    """AssertionError unless `square`, of errors whitened by a covariance, is about `dof`.

    Errors that are larger than the covariance says are refused as those of a wrong noise are;
    smaller ones where they are far smaller.
    """
    from scipy.stats import chi2

    high, scale = chi2.isf(SIGNIFICANCE / 2, dof), float(np.sqrt(square / dof))
    assert square < high, (
        f"{what}: the errors at the truth are {scale:.3g} times as large as its covariance says "
        f"(chi-square {square:.1f}, expected below {high:.1f}); pairs of sensors, the search for "
        "outliers and reports go by it: derive it from the noise in the config"
    )
    assert only_above or scale > 1 / _MOST_CAUTIOUS, (
        f"{what}: the errors at the truth are only {scale:.3g} times what its covariance says, "
        f"expected above {1 / _MOST_CAUTIOUS:.2f}; outliers would pass: derive it from the noise "
        "in the config"
    )


def assert_white(rows: Sequence[Array]) -> None:
    """AssertionError unless residuals (m,) of equal length are uncorrelated with unit variance.

    Each entry of their mean outer product has a standard deviation of 1 / sqrt(n), sqrt(2 / n) on
    the diagonal. Residuals of different lengths are compared in the rows that all have.
    """
    from scipy.stats import norm

    shortest = min(12, *(len(r) for r in rows))
    R = np.array([r[:shortest] for r in rows])
    off = R.T @ R / len(R) - np.eye(shortest)
    z = np.abs(off) * np.sqrt(len(R)) / np.where(np.eye(shortest) > 0, np.sqrt(2), 1.0)
    limit = float(norm.isf(SIGNIFICANCE / shortest**2 / 2))
    i, j = np.unravel_index(int(z.argmax()), z.shape)
    assert z.max() < limit, (
        f"rows {i} and {j} of the residual at the truth have a covariance of "
        f"{off[i, j] + (i == j):.3f}, expected {int(i == j)}: whiten it by the configured noise"
    )
