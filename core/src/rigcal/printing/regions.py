"""What the patches leave visible: disjoint regions without seams."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from rigcal.geometry.se3 import Array
from rigcal.targets.target import Patch

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

_GRID_M = 1e-8
"""Coordinates are rounded to it, so that edges that meet are one."""

Rings = list[Array]
"""Boundary of a region, (K, 2) each, closed: anticlockwise outside, clockwise around holes."""


def visible_regions(patches: Sequence[Patch]) -> list[tuple[float, Rings]]:
    """(grey, rings) of every connected region that is not white, after all painting is done.

    Drawn one by one, patches that share an edge show the ground through it as a hairline: a
    renderer covers half of the edge's pixels twice by half. Regions share no edge.
    """
    layers: dict[float, BaseGeometry] = {}
    painting = sorted(zip(_levels(patches), patches, strict=True), key=_level_and_grey)
    for (_, grey), group in groupby(painting, key=_level_and_grey):
        _paint(layers, grey, [patch.polygon for _, patch in group])
    return [
        (grey, _rings(part))
        for grey, layer in sorted(layers.items())
        if grey < 1.0
        for part in getattr(layer, "geoms", [layer])
        if part.area > 0
    ]


def _level_and_grey(item: tuple[int, Patch]) -> tuple[int, float]:
    return item[0], item[1].grey


def _levels(patches: Sequence[Patch]) -> list[int]:
    """For each patch the number of times that something was painted over below it.

    Patches of one level may be painted in any order: where they overlap they have one grey.
    """
    import shapely

    shapes = [shapely.Polygon(patch.polygon) for patch in patches]
    inner = shapely.buffer(shapes, -_GRID_M, join_style="mitre")
    above, below = shapely.STRtree(shapes).query(inner, "intersects")
    levels = [0] * len(patches)
    for i, j in sorted(zip(above.tolist(), below.tolist(), strict=True)):
        if j < i and patches[i].grey != patches[j].grey:
            levels[i] = max(levels[i], levels[j] + 1)
    return levels


def _paint(layers: dict[float, BaseGeometry], grey: float, polygons: list[Array]) -> None:
    """Add polygons of one grey to its layer, and take them from the other layers."""
    import shapely

    shapes = [shapely.Polygon(polygon) for polygon in polygons]
    painted = shapely.union_all(shapes, grid_size=_GRID_M)
    for other in layers.keys() - {grey}:
        layers[other] = shapely.difference(layers[other], painted, grid_size=_GRID_M)
    if grey in layers:
        painted = shapely.union(layers[grey], painted, grid_size=_GRID_M)
    layers[grey] = painted


def _rings(part: Any) -> Rings:
    import shapely

    oriented = shapely.geometry.polygon.orient(part)
    return [np.asarray(ring.coords) for ring in (oriented.exterior, *oriented.interiors)]
