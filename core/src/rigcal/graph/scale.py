"""Why two sensors do not agree: a target whose dimensions in the rig file are wrong."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.graph.correspondence import MODEL_ERROR_M, Correspondences
from rigcal.graph.relation import OnPlanes
from rigcal.observation import PlaneGeometry, PoseGeometry

_SAMPLES = 400
_LEAST_CHANGE = 0.05


def tests_size(c: Correspondences) -> bool:
    """Whether the pair holds the target's dimensions against measured ranges."""
    return c.pairing == (PoseGeometry, PlaneGeometry)


def scale_that_agrees(
    c: Correspondences, needed: int, rng: np.random.Generator
) -> tuple[float, int] | None:
    """The factor on the target's size with which pose and plane observations agree.

    A camera that takes its target for s times too small sees every plane at d_a instead of s d_a;
    normals stay. Four planes give rotation (normals) and `n_a . t + s d_a = d_b`, linear in t and
    s. Returns s and the number of exposures that agree, at least `needed`; None if no factor helps.
    """
    relation, starts = c.relation, c.starts
    assert isinstance(relation, OnPlanes)
    assert relation.planes_b is not None
    if len(starts) < max(needed, 5):
        return None
    a, b = relation.planes_a, relation.planes_b
    sample = _samples(starts, len(c.exposure), rng)
    A = np.concatenate([a.normal[sample], a.d[sample][..., None]], axis=2)
    well = np.abs(np.linalg.det(A)) > 1e-3
    sample, A = sample[well], A[well]
    R = se3.nearest_rotation(np.swapaxes(a.normal[sample], 1, 2) @ b.normal[sample])
    solution = np.linalg.solve(A, b.d[sample][..., None])[..., 0]
    s = solution[:, 3]
    likely = (s > 0.1) & (s < 10) & (np.abs(s - 1) >= _LEAST_CHANGE)
    T, s = se3.transform(R, solution[:, :3])[likely], s[likely]
    if not len(s):
        return None
    p = np.einsum("sij,hkj->shki", T[:, :3, :3], relation.p_b) + T[:, None, None, :3, 3]
    e = np.einsum("shki,hi->shk", p, a.normal) + s[:, None, None] * a.d[:, None]
    good = np.sqrt(np.mean(e**2, axis=2)) < 3 * np.hypot(relation.sigma, MODEL_ERROR_M)
    counts = np.logical_or.reduceat(good, starts, axis=1).sum(axis=1)
    best = int(counts.argmax())
    return (float(s[best]), int(counts[best])) if counts[best] >= needed else None


def _samples(starts: NDArray[np.intp], total: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """(S, 4) correspondences of four different exposures."""
    ends = np.append(starts[1:], total)
    exposures = rng.permuted(np.tile(np.arange(len(starts)), (_SAMPLES, 1)), axis=1)[:, :4]
    result: NDArray[np.int64] = rng.integers(starts[exposures], ends[exposures])
    return result
