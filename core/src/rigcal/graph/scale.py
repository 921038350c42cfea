"""Why two sensors do not agree: a target whose dimensions in the rig file are wrong."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.correspondence import MODEL_ERROR_M, Correspondences
from rigcal.graph.relation import Index, OnPlanes, Planes
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
    normals stay. Four or more planes give rotation (normals), and places c_b on them that b saw
    `n_a . (R c_b + t) + s d_a = 0`, linear in t and s; a tilt of n_a by noise acts on the board's
    extent only, not on its distance. Returns s and the number of exposures that agree, at least
    `needed`; None if no factor helps.
    """
    relation, starts = c.relation, c.starts
    assert isinstance(relation, OnPlanes)
    assert relation.planes_b is not None
    if len(starts) < max(needed, 5):
        return None
    a, b = relation.planes_a, relation.planes_b
    sample = _samples(starts, len(c.exposure), rng)
    T, s = _solve(a, b, sample)
    likely = (s > 0.1) & (s < 10) & (np.abs(s - 1) >= _LEAST_CHANGE)
    T, s = T[likely], s[likely]
    if not len(s):
        return None
    good = _good(relation, T, s)
    counts = np.logical_or.reduceat(good, starts, axis=1).sum(axis=1)
    best = int(counts.argmax())
    if counts[best] < needed:
        return None
    # Four noisy planes give a rough factor; all that agree with it give a better one.
    T, s = _solve(a, b, np.flatnonzero(good[best])[None])
    return float(s[0]), int(counts[best])


def _solve(a: Planes, b: Planes, sample: Index) -> tuple[Array, Array]:
    """`T_a_b` (M, 4, 4) and factors (M,) of samples (S, 4 or more); none of parallel planes."""
    A = np.concatenate([a.normal[sample], a.d[sample][..., None]], axis=2)
    N = np.swapaxes(A, 1, 2) @ A
    well = np.linalg.det(N) > 1e-6
    sample, A, N = sample[well], A[well], N[well]
    R = se3.nearest_rotation(np.swapaxes(a.normal[sample], 1, 2) @ b.normal[sample])
    reach = np.einsum("smi,sij,smj->sm", a.normal[sample], R, b.center[sample])
    solution = -np.linalg.solve(N, np.swapaxes(A, 1, 2) @ reach[..., None])[..., 0]
    return se3.transform(R, solution[:, :3]), np.asarray(solution[:, 3], np.float64)


def _good(relation: OnPlanes, T: Array, s: Array) -> NDArray[np.bool_]:
    """(M, H) which correspondences agree with transforms (M, 4, 4) and factors (M,)."""
    n, d = relation.planes_a.normal, relation.planes_a.d
    p = np.einsum("sij,hkj->shki", T[:, :3, :3], relation.p_b) + T[:, None, None, :3, 3]
    e = np.einsum("shki,hi->shk", p, n) + s[:, None, None] * d[:, None]
    limit = 3 * np.hypot(relation.sigma, MODEL_ERROR_M)
    result: NDArray[np.bool_] = np.sqrt(np.mean(e**2, axis=2)) < limit
    return result


def _samples(starts: Index, total: int, rng: np.random.Generator) -> Index:
    """(S, 4) correspondences of four different exposures."""
    ends = np.append(starts[1:], total)
    exposures = rng.permuted(np.tile(np.arange(len(starts)), (_SAMPLES, 1)), axis=1)[:, :4]
    chosen: Index = rng.integers(starts[exposures], ends[exposures], dtype=np.intp)
    return chosen
