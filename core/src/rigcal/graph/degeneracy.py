"""What a set of exposures cannot say about the transform between two sensors, in words."""

from __future__ import annotations

import numpy as np

from rigcal.geometry.se3 import Array
from rigcal.graph.correspondence import Correspondences
from rigcal.graph.refinement import Fit
from rigcal.graph.relation import Index, OnPlanes, OnPoints

# Beyond these a pair leaves its transform open (standard deviations, rad and m).
OPEN = np.array([np.radians(5.0)] * 3 + [0.25] * 3)
_AXES = ("rotation about x", "rotation about y", "rotation about z", "x", "y", "z")
# Information counts as far as it exceeds so many times what the noise feigns.
_NOISE_FACTOR = 4.0
# Boards are alike when their tilts and places differ by less (rad, m).
_SAME_TILT, _SAME_PLACE_M = np.radians(3.0), 0.05


def open_direction(c: Correspondences, fit: Fit) -> str:
    """Which direction of `T_a_b` the inliers leave open, and why; empty if none.

    A direction is open where the information is small, or where it is only the noise that made the
    boards differ: parallel boards with noisy tilts feign a pose that the data do not hold.
    """
    # In units of what counts as open, so that rotation and translation compare.
    known = (fit.information - _NOISE_FACTOR * fit.from_noise) * np.outer(OPEN, OPEN)
    values, vectors = np.linalg.eigh(known)
    if values[0] >= 1.0:
        return ""
    axis = _AXES[int(np.abs(vectors[:, 0]).argmax())]
    return f"they leave {axis} of the second sensor open: {cause(c, fit.keep)}"


def cause(c: Correspondences, h: Index) -> str:
    """Why correspondences h leave a transform open, as far as can be told, and what to do."""
    return in_common(c, h) or "more exposures with other places and tilts of the board are needed"


def in_common(c: Correspondences, h: Index) -> str:
    """What correspondences h have in common that leaves a transform open; empty if nothing."""
    match c.relation:
        case OnPlanes() as relation if len(h):
            return _of_planes(relation, h)
        case OnPoints() as relation if len(h) and _spread(relation.p_a[h])[1] < _SAME_PLACE_M:
            return "the points lie on a line; show the board at other heights and distances"
    return ""


def _of_planes(relation: OnPlanes, h: Index) -> str:
    n, d = relation.planes_a.normal[h], relation.planes_a.d[h]
    tilts = np.sqrt(np.maximum(np.linalg.eigvalsh(n.T @ n / len(n)), 0.0))
    if tilts[1] < _SAME_TILT:
        if np.std(d) < _SAME_PLACE_M:
            return (
                "the board stood at one place; move it and tilt it in several directions (or what "
                "agrees is not the board but something that never moves, a wall)"
            )
        return "all boards are parallel; tilt the board in several directions"
    if relation.planes_b is None and np.std(relation.p_b[h], axis=0).max() < _SAME_PLACE_M:
        return "the second sensor always sees the board at one place; move the board"
    if tilts[0] < _SAME_TILT:
        return "all boards are turned about one axis only; tilt the board about another one too"
    return ""


def _spread(p: Array) -> Array:
    """(3,) standard deviations of points (n, 3) along their principal axes, largest first."""
    result: Array = np.linalg.svd(p - p.mean(axis=0), compute_uv=False) / np.sqrt(len(p))
    return np.pad(result, (0, 3 - len(result)))
