"""Clouds -> board candidates, without any idea of where the board is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import inside_convex, tangent_basis
from rigcal.observation import Candidate, Detection, PlaneGeometry
from rigcal.targets.target import Target
from rigcal_lrf3d import plane, segment
from rigcal_lrf3d.cloud import Cloud
from rigcal_lrf3d.config import Lrf3dConfig
from rigcal_lrf3d.outline import Placement, hull, place_rectangle
from rigcal_lrf3d.segment import Scales

MAX_CANDIDATES = 6

_MIN_COVERAGE = 0.4
_MIN_CONTAINMENT = 0.6
_MIN_POINTS = 20
_STRAY = 0.1
"""Cells with less than this share of a region's usual points hold stray returns."""


def detect(cloud: Cloud, config: Lrf3dConfig, target: Target) -> Detection:
    """Planes of the board's size and outline, best first, at most 6; else a reason.

    Flat regions are grown from the cloud (walls, floor and the board each become one), the points
    in a region's plane that hang together with it are compared with the board's rectangle, and the
    plane is estimated from the ranges of the returns in the rectangle. The score is the share of
    the board that is seen times the share of the plane's points that the board explains.
    """
    scales, size = Scales.of(target.size, config.noise), target.size
    if len(cloud.points) < _MIN_POINTS:
        return Detection((), reason=f"the cloud has {len(cloud.points)} returns, too few")
    grid, count = segment.voxel_grid(cloud.points, scales.voxel)
    regions = segment.flat_regions(grid, count, scales)
    tried = [
        _candidate(cloud.points, grid, count, region, size, scales, config) for region in regions
    ]
    found = sorted((c for c in tried if isinstance(c, Candidate)), key=lambda c: -c.score)
    if found:
        return Detection(tuple(_distinct(found)[:MAX_CANDIDATES]))
    return Detection((), reason=_reason([t for t in tried if isinstance(t, str)], target))


def _candidate(
    points: Array,
    grid: Array,
    count: NDArray[np.int64],
    region: NDArray[np.int64],
    size: Array,
    scales: Scales,
    config: Lrf3dConfig,
) -> Candidate | str:
    """The candidate of one flat region of the grid, or why it is not the board, in a word."""
    extent = _extent(grid[region])
    if extent[1] < 0.4 * size.min() or extent[0] < 0.4 * size.max():
        return "too small"
    if extent[0] > 1.5 * np.linalg.norm(size):
        return "too large"
    thickness = float(scales.thickness(np.linalg.norm(grid[region].mean(axis=0))))
    n, d = plane.coarse(grid[region], thickness)
    if d < scales.reach:
        return "seen edge-on"
    near = np.flatnonzero(
        (np.abs(grid @ n + d) < thickness)
        & (count > _STRAY * np.median(count[region]))
        & (np.linalg.norm(grid - grid[region].mean(axis=0), axis=1) < 2 * np.linalg.norm(size))
    )
    together = segment.connected(grid[near], np.isin(near, region), scales.reach)
    basis = tangent_basis(n)
    placed = place_rectangle(grid[near[together]] @ basis, size, scales.voxel)
    if placed.containment < _MIN_CONTAINMENT:
        return "too large"
    if placed.coverage < _MIN_COVERAGE:
        return "too small"
    return _refined(points, n, d, basis, placed, scales, config)


def _refined(
    points: Array,
    n: Array,
    d: float,
    basis: Array,
    placed: Placement,
    scales: Scales,
    config: Lrf3dConfig,
) -> Candidate | str:
    """The candidate of the returns in the placed rectangle, its plane by maximum likelihood.

    Returns near the rectangle's edges show the outline but not the plane: there are mixed pixels,
    and hands and arms that hold the board.
    """
    thickness = scales.thickness(np.linalg.norm(points, axis=1))
    close = np.abs(points @ n + d) < 2 * thickness
    near, thickness = points[close], thickness[close]
    foot = plane.beam_feet(near, n, d) @ basis
    interior = near[inside_convex(foot, placed.polygon, margin=-scales.edge)]
    fitted = plane.fit(interior, n, d, config.noise, scales.voxel)
    if fitted is None:
        return "too few returns"
    inliers = interior[fitted.inliers]
    final = tangent_basis(fitted.normal)
    on_board = inside_convex(foot, placed.polygon, margin=scales.voxel / 2)
    on_board &= np.abs(near @ fitted.normal + fitted.d) < thickness
    seen = near[on_board]
    feet = plane.beam_feet(seen, fitted.normal, fitted.d)
    boundary = hull(feet @ final) @ final.T - fitted.d * fitted.normal
    geometry = PlaneGeometry(fitted.normal, fitted.d, fitted.center, fitted.covariance, boundary)
    middle = np.linalg.norm(fitted.center)
    rms = max(fitted.rms * float(config.noise.of(middle)), 1e-9)
    flatness = min(1.0, float(scales.flat(middle)) / rms)
    score = placed.coverage * placed.containment * flatness
    return Candidate(geometry, {"points": inliers.astype(np.float32)}, score)


def _extent(points: Array) -> Array:
    """(2,) lengths (m) of points (M, 3) along their two widest principal axes, longest first."""
    centered = points - points.mean(axis=0)
    axes = np.linalg.eigh(centered.T @ centered)[1][:, :0:-1]
    result: Array = np.ptp(centered @ axes, axis=0)
    return result


def _distinct(candidates: list[Candidate]) -> list[Candidate]:
    """Candidates without those that share most of their returns with a better one."""
    kept: list[Candidate] = []
    for candidate in candidates:
        g = candidate.geometry
        assert isinstance(g, PlaneGeometry)
        if not any(_same(g, other.geometry) for other in kept):
            kept.append(candidate)
    return kept


def _same(a: PlaneGeometry, b: object) -> bool:
    assert isinstance(b, PlaneGeometry)
    return bool(np.linalg.norm(a.center - b.center) < 0.1 and a.normal @ b.normal > 0.98)


def _reason(rejected: list[str], target: Target) -> str:
    width, height = target.size
    if not rejected:
        return "no flat region in the cloud"
    counts = ", ".join(f"{rejected.count(word)} {word}" for word in dict.fromkeys(rejected))
    return (
        f"none of {len(rejected)} flat regions has the size of the board, "
        f"{width:.3g} x {height:.3g} m ({counts})"
    )
