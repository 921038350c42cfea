"""What one sensor saw, as a node of MSG-Cal's graph, and how two of them compare in metres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import tangent_basis
from rigcal.graph.board import board_points, half_size
from rigcal.observation import Geometry, LineGeometry, PlaneGeometry, PointGeometry, PoseGeometry
from rigcal.targets.target import Target


@dataclass(frozen=True, eq=False)
class ObservationNode:
    """An observed geometry with a frame o of its own: `T_s_o` (4, 4) as it was seen.

    A pose has the target's frame, a plane its normal as z, a line its direction as x; a point has
    only its origin. `points` (m, 3) stand for it, in o: the board's corners, four points as far
    out on a plane, the ends of a line, the point itself. Motions of o that do not move them,
    such as a line's turn about itself, mean nothing.
    """

    sensor: str
    candidate: int
    geometry: Geometry
    T_s_o: Array
    points: Array


@dataclass(frozen=True, eq=False)
class Relation:
    """Points of node b that lie in the plane z = 0 of node a (`planar`), or on points of a.

    p_b, q_a (m, 3) in the frames of the nodes; `rank` counts what it can contradict.
    """

    a: int
    b: int
    p_b: Array
    q_a: Array
    planar: bool
    rank: int


def node(sensor: str, candidate: int, g: Geometry, target: Target) -> ObservationNode:
    """The node of what a sensor saw of the target; `candidate` is its number in the observation."""
    match g:
        case PoseGeometry():
            return ObservationNode(sensor, candidate, g, g.T_s_t, target.outline_points)
        case PlaneGeometry():
            R = np.column_stack([tangent_basis(g.normal), g.normal])
            T, points = se3.transform(R, g.center), board_points(g, half_size(target))
        case LineGeometry():
            along = (g.end - g.start) / np.linalg.norm(g.end - g.start)
            R = np.column_stack([along, tangent_basis(along)])
            T, points = se3.transform(R, (g.start + g.end) / 2), np.stack([g.start, g.end])
        case _:
            T, points = se3.transform(np.eye(3), g.position), g.position[None]
    return ObservationNode(sensor, candidate, g, T, se3.apply(se3.inverse(T), points))


def relation(nodes: tuple[ObservationNode, ...], a: int, b: int, target: Target) -> Relation | None:
    """The observation-observation edge between two nodes; None if their geometries allow none.

    Two lines, or a point and a plane, say too little of each other: no pair does without a pose or
    a plane on one side.
    """
    g_a, g_b = nodes[a].geometry, nodes[b].geometry
    if isinstance(g_a, PoseGeometry | PointGeometry) and isinstance(
        g_b, PoseGeometry | PointGeometry
    ):
        p_t = _known_points(g_a, g_b, target)
        p_b, q_a = _placed(g_b, p_t), _placed(g_a, p_t)
        return Relation(a, b, p_b, q_a, planar=False, rank=6 if len(p_t) > 1 else 3)
    if isinstance(g_a, LineGeometry) or (
        isinstance(g_a, PoseGeometry) and isinstance(g_b, PlaneGeometry)
    ):
        # Ends of a line lie in a plane; the board's corners, which a pose knows, in a seen plane.
        a, b, g_a, g_b = b, a, g_b, g_a
    if isinstance(g_a, LineGeometry | PointGeometry) or isinstance(g_b, PointGeometry):
        return None
    p_b = nodes[b].points
    rank = 2 if isinstance(g_b, LineGeometry) else 3
    return Relation(a, b, p_b, np.zeros_like(p_b), planar=True, rank=rank)


def _known_points(a: Geometry, b: Geometry, target: Target) -> Array:
    """(m, 3) points of the target whose place both observations know."""
    for g in (a, b):
        if isinstance(g, PointGeometry):
            return g.target_point[None]
    return target.outline_points


def _placed(g: Geometry, p_t: Array) -> Array:
    """Points of the target in the frame of the node that saw them."""
    return np.zeros_like(p_t) if isinstance(g, PointGeometry) else p_t
