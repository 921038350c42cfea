"""Several frames of one exposure as one candidate, with an honest covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import tangent_basis
from rigcal.observation import (
    Candidate,
    Geometry,
    LineGeometry,
    MeanGeometry,
    PlaneGeometry,
    PointGeometry,
    PoseGeometry,
)


def mean_of(geometries: Sequence[Geometry], common: float | None = None) -> MeanGeometry:
    """The information-weighted mean of geometries of one kind, seen in one exposure.

    `common` is the share of a frame's variance that is in all frames alike, and stays; None: what
    these frames show of it (see `common_share`). Their own scatter averages out, whatever it is:
    more than configured where the board trembles.
    """
    first = geometries[len(geometries) // 2]
    x, covariance = _all_local(first, geometries)
    information = np.linalg.inv(covariance)
    total = np.linalg.inv(information.sum(axis=0))
    mean = total @ np.einsum("nij,nj->i", information, x)
    scatter, dof = _scatter(x - mean, covariance, first)
    if common is None:
        common = max(1 - scatter, 0.0)
    # A scatter that few frames show may be larger: the variance of Student's t, dof / (dof - 2).
    own = scatter * dof / max(dof - 2, 1) / len(x)
    ratio = common + own if len(x) > 1 else 1.0
    one = total * len(x)
    shared = _shared(first, one)
    geometry = _moved(first, mean, one * ratio + shared * (1 - ratio), geometries)
    return MeanGeometry(geometry, ratio, scatter)


def common_share(exposures: Sequence[Sequence[Geometry]]) -> float:
    """The share of a frame's variance that all frames of an exposure have in common: 0 to 1.

    The scatter of the frames, in units of their covariances, shows their own noise; what is missing
    to 1 is a bias that they share, as by the places of pixels and beams. The median over exposures
    counts: one exposure shows it roughly, and in some the board trembles.
    """
    shown = []
    for geometries in exposures:
        if len(geometries) > 1:
            x, covariance = _all_local(geometries[0], geometries)
            shown.append(_scatter(x - x.mean(axis=0), covariance, geometries[0])[0])
    return max(1 - float(np.median(shown)), 0.0) if shown else 0.0


def _shared(g: Geometry, covariance: Array) -> Array:
    """The part of a covariance that all frames have in common whatever their scatter.

    A segment ends at the same beam in every frame.
    """
    if not isinstance(g, LineGeometry):
        return np.zeros_like(covariance)
    along = (g.end - g.start) / max(float(np.linalg.norm(g.end - g.start)), 1e-9)
    P = np.kron(np.eye(2), np.outer(along, along))
    result: Array = P @ covariance @ P
    return result


def combine_geometry(candidates: Sequence[Candidate], mean: MeanGeometry) -> Candidate:
    """The mean as a candidate, for sensor types without measurements of their own.

    The score is the mean score.
    """
    return Candidate(mean.geometry, {}, float(np.mean([c.score for c in candidates])))


def nearest_to_mean(candidates: Sequence[Candidate], mean: MeanGeometry) -> Candidate:
    """The candidate nearest to the mean, which stands for all, no better than it is alone."""
    apart, covariance = _all_local(mean.geometry, [c.geometry for c in candidates])
    distance = np.einsum("ni,nij,nj->n", apart, np.linalg.inv(covariance), apart)
    return candidates[int(np.argmin(distance))]


def _scatter(apart: Array, covariance: Array, first: Geometry) -> tuple[float, int]:
    """Mean square of deviations (N, d) from their mean, by covariances (N, d, d), and its dof."""
    if isinstance(first, LineGeometry):
        # A segment ends at the same beam every time, and never leaves the scan's plane.
        along = first.end - first.start
        across = np.array([-along[1], along[0], 0.0]) / max(np.hypot(*along[:2]), 1e-9)
        N = np.zeros((2, 6))
        N[0, :3] = N[1, 3:] = across
        apart, covariance = apart @ N.T, N @ covariance @ N.T
    squares = np.einsum("ni,nij,nj->", apart, np.linalg.inv(covariance), apart)
    dof = apart.shape[1] * (len(apart) - 1)
    return float(squares) / max(dof, 1), dof


def _all_local(origin: Geometry, geometries: Sequence[Geometry]) -> tuple[Array, Array]:
    """Coordinates (N, d) about one geometry, and covariances (N, d, d)."""
    x, covariance = zip(*(_local(origin, g) for g in geometries), strict=True)
    return np.array(x), np.array(covariance)


def _local(origin: Geometry, g: Geometry) -> tuple[Array, Array]:
    """Coordinates (d,) of a geometry about another of its kind, and their covariance (d, d)."""
    match origin, g:
        case PoseGeometry(), PoseGeometry():
            return se3.log(se3.inverse(origin.T_s_t) @ g.T_s_t), g.covariance
        case PlaneGeometry(), PlaneGeometry():
            basis, own = tangent_basis(origin.normal), tangent_basis(g.normal)
            tilt = basis.T @ np.cross(origin.normal, g.normal)
            offset = -(g.normal @ origin.center + g.d)
            # A tilt about its own centre lifts the plane at the other's.
            J = np.eye(3)
            J[:2, :2] = basis.T @ own
            J[2, :2] = np.cross(g.normal, g.center - origin.center) @ own
            return np.append(tilt, offset), J @ g.covariance @ J.T
        case LineGeometry(), LineGeometry():
            ends = np.concatenate([g.start - origin.start, g.end - origin.end])
            return ends, g.covariance
        case PointGeometry(), PointGeometry():
            return g.position - origin.position, g.covariance
    raise TypeError(f"{type(origin).__name__} and {type(g).__name__} have no mean")


def _moved(origin: Geometry, x: Array, covariance: Array, all_of: Sequence[Geometry]) -> Geometry:
    """The geometry at coordinates x about another one."""
    match origin:
        case PoseGeometry():
            return PoseGeometry(origin.T_s_t @ se3.exp(x), covariance)
        case PlaneGeometry():
            tilt = tangent_basis(origin.normal) @ x[:2]
            n = origin.normal + np.cross(tilt, origin.normal)
            n /= np.linalg.norm(n)
            center = origin.center + x[2] * n
            d = -float(n @ center)
            boundary = origin.boundary - (origin.boundary @ n + d)[:, None] * n
            return PlaneGeometry(n, d, center, covariance, boundary)
        case LineGeometry():
            lines = [g for g in all_of if isinstance(g, LineGeometry)]
            return LineGeometry(
                origin.start + x[:3],
                origin.end + x[3:],
                covariance,
                2 * sum(g.start_is_edge for g in lines) > len(lines),
                2 * sum(g.end_is_edge for g in lines) > len(lines),
            )
    return replace(origin, position=origin.position + x, covariance=covariance)
