"""Planes, lines and polygons as plain arrays.

A plane is a unit normal n (3,) and a distance d with `n . p + d = 0` for its points.
"""

from __future__ import annotations

import numpy as np

from rigcal.geometry.se3 import Array


def plane_of_target(T_s_t: Array) -> tuple[Array, Array]:
    """Normal n (..., 3) and distance d (...) of the target's plane z = 0 in the sensor's frame."""
    T = np.asarray(T_s_t, dtype=np.float64)
    n = T[..., :3, 2]
    return n, -np.einsum("...i,...i->...", n, T[..., :3, 3])


def tangent_basis(n: Array) -> Array:
    """(..., 3, 2) orthonormal columns orthogonal to unit vectors n, a fixed function of n."""
    n = np.asarray(n, dtype=np.float64)
    first = np.cross(n, np.eye(3)[np.argmin(np.abs(n), axis=-1)])
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, np.cross(n, first)], axis=-1)


def fit_plane(points: Array) -> tuple[Array, float]:
    """Total-least-squares plane of (N, 3) points, its normal turned towards the origin (d >= 0)."""
    points = np.asarray(points, dtype=np.float64)
    center = points.mean(axis=0)
    n: Array = np.linalg.svd(points - center, full_matrices=False)[2][2]
    d = -float(n @ center)
    return (-n, -d) if d < 0 else (n, d)


def half_planes(polygon: Array) -> tuple[Array, Array]:
    """Outward unit normals (K, 2) and offsets (K,) of the sides of a convex anticlockwise polygon.

    `normal . p <= offset` on the inner side of each.
    """
    polygon = np.asarray(polygon, np.float64)
    edges = np.roll(polygon, -1, axis=0) - polygon
    outward = np.stack([edges[:, 1], -edges[:, 0]], axis=-1)
    outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
    return outward, np.einsum("kj,kj->k", outward, polygon)


def inside_convex(points: Array, polygon: Array, margin: float = 0.0) -> np.ndarray:
    """Which of (..., 2) points lie inside a convex, anticlockwise (K, 2) polygon.

    A point is inside when it is on the inner side of every boundary half-plane; `margin` > 0 (m)
    widens the polygon, < 0 shrinks it.
    """
    outward, offsets = half_planes(polygon)
    points = np.asarray(points, np.float64)
    result: np.ndarray = np.all(points @ outward.T - offsets <= margin, axis=-1)
    return result
