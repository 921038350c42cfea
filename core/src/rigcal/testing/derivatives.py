"""Whether a Jacobian is the derivative that differences give, and if not, which entry is wrong."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigcal.geometry.se3 import Array

MOTION = (
    "rotation x",
    "rotation y",
    "rotation z",
    "translation x",
    "translation y",
    "translation z",
)
"""Columns of a derivative by a motion of the target."""
OF_MOTION = (
    "the columns are rotation (rad), then translation (m) of a right perturbation: "
    "T_s_t exp(xi), xi in the target's frame"
)


def assert_derivative(
    J: Array, differences: Array, columns: Sequence[str], tolerance: float | Array, meaning: str
) -> None:
    """AssertionError unless J (m, n) is `differences` (m, n) to an absolute `tolerance` (n,) or ().

    It names the worst entry by the name of its column, and says what the columns mean.
    """
    assert J.shape == differences.shape, (
        f"the derivative has shape {J.shape}, expected {differences.shape}: {meaning}"
    )
    apart = np.abs(J - differences)
    bad = ~(apart <= tolerance)
    if not bad.any():
        return
    worst = np.where(bad, np.nan_to_num(apart, nan=np.inf), -1.0).argmax()
    i, j = divmod(int(worst), J.shape[1])
    wrong = ", ".join(c for c, column in zip(columns, bad.T, strict=True) if column.any())
    raise AssertionError(
        f"the derivative is not that of the residual in column {wrong}; the worst, row {i} by "
        f"{columns[j]}: {J[i, j]:.6g}, by differences {differences[i, j]:.6g}; {meaning}"
    )
