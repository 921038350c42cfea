"""Why two sensors do not agree: a target whose dimensions in the rig file are wrong."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.correspondence import Correspondences

_SAMPLES = 400
_LEAST_CHANGE = 0.05


def scale_that_agrees(
    c: Correspondences, n_b: Array, d_b: Array, needed: int, rng: np.random.Generator
) -> tuple[float, int] | None:
    """The factor on the target's size with which pose and plane observations agree.

    A camera that takes its target for s times too small sees every plane at d_a instead of s d_a;
    normals stay. Four planes give rotation (normals) and `n_a . t + s d_a = d_b`, linear in t and
    s. c: pose-plane correspondences; n_b (H, 3), d_b (H,): the planes seen from b. Returns s and
    the number of exposures that agree, at least `needed`; None if no factor helps.
    """
    starts = np.flatnonzero(np.diff(c.exposure, prepend=-1))
    if len(starts) < max(needed, 5):
        return None
    sample = _samples(starts, len(c.exposure), rng)
    R = se3.nearest_rotation(np.swapaxes(c.n_a[sample], 1, 2) @ n_b[sample])
    A = np.concatenate([c.n_a[sample], c.d_a[sample][..., None]], axis=2)
    well = np.abs(np.linalg.det(A)) > 1e-3
    solution = np.linalg.solve(A[well], d_b[sample][well][..., None])[..., 0]
    best: tuple[float, int] | None = None
    for R_a_b, (*t, s) in zip(R[well], solution, strict=True):
        if not 0.1 < s < 10 or abs(s - 1) < _LEAST_CHANGE:
            continue
        p = c.p_b @ R_a_b.T + np.array(t)
        e = np.einsum("hki,hi->hk", p, c.n_a) + s * c.d_a[:, None]
        good = np.sqrt(np.mean(e**2, axis=1)) < 3 * c.sigma
        count = int(np.logical_or.reduceat(good, starts).sum())
        if count >= needed and (best is None or count > best[1]):
            best = float(s), count
    return best


def _samples(starts: NDArray[np.intp], total: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """(S, 4) correspondences of four different exposures."""
    ends = np.append(starts[1:], total)
    exposures = rng.permuted(np.tile(np.arange(len(starts)), (_SAMPLES, 1)), axis=1)[:, :4]
    result: NDArray[np.int64] = rng.integers(starts[exposures], ends[exposures])
    return result
