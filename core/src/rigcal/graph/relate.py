"""From the geometries of two sensors to the relation between them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import tangent_basis
from rigcal.graph.board import center_of, half_size, plane_of
from rigcal.graph.relation import OnPlanes, OnPoints, OnPoses, Planes, Relation
from rigcal.observation import (
    Geometry,
    LineGeometry,
    Observation,
    PlaneGeometry,
    PointGeometry,
    PoseGeometry,
)
from rigcal.targets.target import Target

Pairing = tuple[type[Geometry], type[Geometry]]

_POSE, _PLANE, _LINE, _POINT = PoseGeometry, PlaneGeometry, LineGeometry, PointGeometry
_DETERMINING: frozenset[Pairing] = frozenset(
    {
        (_POSE, _POSE),
        (_POSE, _POINT),
        (_POINT, _POSE),
        (_POINT, _POINT),
        (_POSE, _PLANE),
        (_PLANE, _PLANE),
        (_POSE, _LINE),
        (_PLANE, _LINE),
        (_PLANE, _POINT),
    }
)
_NAMES = {_POSE: "poses", _PLANE: "planes", _LINE: "lines", _POINT: "points"}
# Corners of an equilateral triangle in the unit circle: three points that stand for a plane.
_TRIANGLE = np.array([[1.0, 0.0], [-0.5, np.sqrt(0.75)], [-0.5, -np.sqrt(0.75)]])
# Their distances from another plane as a shift and two tilts; the same for the ends of a line.
_ROWS_OF_PLANE = np.vstack([np.ones(3), 2 * _TRIANGLE.T]) / 3
_ROWS_OF_LINE = np.array([[0.5, 0.5], [0.5, -0.5]])


def pairing_of(a: Geometry, b: Geometry) -> Pairing | None:
    """The kinds of observations a, b if, in this order, they fix a transform; else None."""
    pairing = type(a), type(b)
    if pairing == (_POINT, _POINT):
        # Two different points of the board know nothing of each other.
        assert isinstance(a, PointGeometry)
        assert isinstance(b, PointGeometry)
        return pairing if np.allclose(a.target_point, b.target_point, atol=1e-4) else None
    return pairing if pairing in _DETERMINING else None


# docs/adr/0011-pairs-of-sensors.md shows why edges of the board do not make lines enough.
_BECAUSE: dict[frozenset[type[Geometry]], str] = {
    frozenset({_LINE}): (
        "each leaves the board free to turn about it; where their ends are edges of the board, a "
        "transform and its mirror image (z, roll and pitch of opposite sign) still explain them "
        "alike. A camera or a 3D sensor has to see the board too"
    ),
    frozenset({_LINE, _POINT}): "the board is free to turn about the line",
    frozenset({_POINT}): "they are different points of the target",
}


def why_undetermined(pairs: Sequence[tuple[Observation, Observation]]) -> str:
    """Why the observations that two sensors share determine no transform, in words."""
    if not pairs:
        return "no exposure"
    first, second = (type(o.candidates[0].geometry) for o in pairs[0])
    kinds = " and ".join(sorted({_NAMES[first], _NAMES[second]}))
    reason = f"{kinds} of one board do not determine a transform"
    because = _BECAUSE.get(frozenset({first, second}))
    return f"{reason}: {because}" if because else reason


def relate(
    pairing: Pairing, seen_a: Sequence[Geometry], seen_b: Sequence[Geometry], target: Target
) -> Relation:
    """The relation of H correspondences: what a and what b saw in each of them."""
    half = half_size(target)
    if pairing == (_POSE, _POSE):
        return _on_poses(seen_a, seen_b, target, half)
    if pairing[0] is _POINT or pairing == (_POSE, _POINT):
        p_t = [_common_point(a, b) for a, b in zip(seen_a, seen_b, strict=True)]
        (p_a, C_a), (p_b, C_b) = _points(seen_a, p_t), _points(seen_b, p_t)
        sigma = np.sqrt(_mean_variance(C_a) + _mean_variance(C_b))
        return OnPoints(p_a, C_a, p_b, C_b, sigma)
    return _on_planes(seen_a, seen_b, half)


def _on_poses(
    seen_a: Sequence[Geometry], seen_b: Sequence[Geometry], target: Target, half: float
) -> OnPoses:
    (T_a, C_a), (T_b, C_b) = _poses(seen_a), _poses(seen_b)
    c = np.diagonal(C_a + C_b, axis1=1, axis2=2)
    # A tilt moves the corners of the board out of its plane: two of three axes bear on it.
    sigma = np.sqrt(c[:, :3].mean(axis=1) * 2 * half**2 + c[:, 3:].mean(axis=1))
    return OnPoses(T_a, C_a, T_b, C_b, sigma, half, target.outline_points)


def _on_planes(seen_a: Sequence[Geometry], seen_b: Sequence[Geometry], half: float) -> OnPlanes:
    a = _planes(seen_a)
    near_a = np.array([center_of(g) for g in seen_a])
    variance = a.covariance[:, 0, 0] + a.covariance[:, 1, 1]
    variance = variance * half**2 / 2 + a.covariance[:, 2, 2]
    b: Planes | None = None
    if isinstance(seen_b[0], PlaneGeometry):
        b = _planes(seen_b)
        p_b = b.center[:, None] + half * _TRIANGLE @ np.swapaxes(b.basis, 1, 2)
        g = b.influence(p_b)
        C = g @ b.covariance @ np.swapaxes(g, 1, 2)
        own, rows = _mean_variance(C), _ROWS_OF_PLANE
        C_b = np.einsum("hkl,hi,hj->hkilj", C, b.normal, b.normal)
    elif isinstance(seen_b[0], LineGeometry):
        p_b, C, own = _lines(seen_b)
        rows = _ROWS_OF_LINE
        C_b = C.reshape(-1, 2, 3, 2, 3)
    else:
        p, C = _points(seen_b, [])
        p_b, C_b, own, rows = p[:, None], C[:, None, :, None], _mean_variance(C), np.eye(1)
    m = 3 * p_b.shape[1]
    sigma, components = np.sqrt(variance + own), (0, 1, 1)[: len(rows)]
    return OnPlanes(a, p_b, C_b.reshape(-1, m, m), sigma, b, near_a, rows, components)


def _mean_variance(C: Array) -> Array:
    """(H,) mean of the diagonals of (H, k, k)."""
    return np.asarray(np.trace(C, axis1=1, axis2=2) / C.shape[-1], dtype=np.float64)


def _planes(seen: Sequence[Geometry]) -> Planes:
    """Of a pose the plane, with its part of the covariance."""
    n, d = zip(*(plane_of(g) for g in seen), strict=True)
    normal = np.array(n)
    basis = tangent_basis(normal)
    covariance = np.array(
        [g.covariance for g in seen if isinstance(g, PlaneGeometry | PoseGeometry)]
    )
    if isinstance(seen[0], PoseGeometry):
        L = np.zeros((len(seen), 3, 6))
        # A right perturbation [w, v] tilts by R w and moves along the normal by v_z.
        L[:, :2, :3] = np.swapaxes(basis, 1, 2) @ _poses(seen)[0][:, :3, :3]
        L[:, 2, 5] = 1.0
        covariance = L @ covariance @ np.swapaxes(L, 1, 2)
    return Planes(normal, np.array(d), np.array([center_of(g) for g in seen]), basis, covariance)


def _poses(seen: Sequence[Geometry]) -> tuple[Array, Array]:
    """(H, 4, 4) and covariances (H, 6, 6)."""
    poses = [g for g in seen if isinstance(g, PoseGeometry)]
    return np.array([g.T_s_t for g in poses]), np.array([g.covariance for g in poses])


def _lines(seen: Sequence[Geometry]) -> tuple[Array, Array, Array]:
    """Ends (H, 2, 3), covariances (H, 6, 6), and variances (H,) across the lines, m^2."""
    lines = [g for g in seen if isinstance(g, LineGeometry)]
    p = np.array([[g.start, g.end] for g in lines])
    C = np.array([g.covariance for g in lines])
    v = p[:, 1] - p[:, 0]
    across = np.column_stack([-v[:, 1], v[:, 0], 0 * v[:, 0]])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    variance = np.einsum("hi,hkikj,hj->h", across, C.reshape(-1, 2, 3, 2, 3), across) / 2
    return p, C, variance


def _common_point(a: Geometry, b: Geometry) -> Array:
    return next(g.target_point for g in (a, b) if isinstance(g, PointGeometry))


def _points(seen: Sequence[Geometry], p_t: Sequence[Array]) -> tuple[Array, Array]:
    """(H, 3) and covariances (H, 3, 3): points that were seen, or those p_t of poses."""
    if isinstance(seen[0], PointGeometry):
        points = [g for g in seen if isinstance(g, PointGeometry)]
        return np.array([g.position for g in points]), np.array([g.covariance for g in points])
    T, C = _poses(seen)
    p, R = np.array(p_t), T[:, :3, :3]
    J = np.concatenate([-R @ se3.skew(p), R], axis=-1)
    return np.einsum("hij,hj->hi", R, p) + T[:, :3, 3], J @ C @ np.swapaxes(J, 1, 2)
