"""Board poses that somebody could show: in reach, clear of the rig, in view of two sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.directions import circle, facing, sphere
from rigcal.geometry.se3 import Array
from rigcal.planning.site import Site, can_be_planned
from rigcal.visibility import spots_in_view

_DIRECTIONS = 2000
# Draws for each pose that is wanted, and after how many in vain there is no hope.
_DRAWS, _HOPELESS = 20, 300
# Of the board's diagonal, or of the rig's extent where that is larger.
_NEAR, _FAR, _FAR_OF_RIG = 1.0, 3.0, 1.5
_SHIFT = 0.4
# Roll about the board's normal, leaning, turning: what can be held by hand.
_MOST_RPY_DEG = np.array([45.0, 35.0, 40.0])
_MOST_TILT = np.radians(50.0)
# How far a pose is varied, [rotation (rad), translation (m)], and draws for each that can be used.
_VARIED = np.array([0.2, 0.2, 0.2, 0.15, 0.15, 0.15])
_TRIES = 4


@dataclass(frozen=True, eq=False)
class BoardPose:
    """`T_root_t` (4, 4) of the target named, and the sensors that have it in view."""

    target: str
    T_root_t: Array
    seen_by: tuple[str, ...]


def draw_candidates(
    site: Site, counts: Mapping[str, int], rng: np.random.Generator
) -> list[BoardPose]:
    """So many poses in the view of each sensor, spread over the directions and distances there.

    Poses out of reach are taken for a sensor only where it has no others. A sensor that shares its
    view with none has none.
    """
    return [pose for name, n in counts.items() for pose in _in_view_of(site, name, n, rng)]


def vary(site: Site, pose: BoardPose, count: int, rng: np.random.Generator) -> list[BoardPose]:
    """Up to `count` poses like this one that can be shown too."""
    target, found = site.targets[pose.target], list[BoardPose]()
    for xi in rng.normal(0.0, _VARIED, (_TRIES * count, 6)):
        T_root_t = pose.T_root_t @ se3.exp(xi)
        if site.in_reach(target, T_root_t) and site.is_clear(target, T_root_t):
            seen_by = _seen_by(site, target.name, T_root_t)
            if len(seen_by) >= 2 and _tilt(site, seen_by, T_root_t) < _MOST_TILT:
                found.append(BoardPose(target.name, T_root_t, seen_by))
        if len(found) == count:
            break
    return found


def _tilt(site: Site, names: Sequence[str], T_root_t: Array) -> float:
    """The angle by which a board does not face that of the sensors which it faces most."""
    toward = np.array([site.T_root_s[name][:3, 3] for name in names]) - T_root_t[:3, 3]
    cosines = toward @ T_root_t[:3, 2] / np.linalg.norm(toward, axis=1)
    return float(np.arccos(np.clip(cosines.max(), -1.0, 1.0)))


def _in_view_of(site: Site, name: str, count: int, rng: np.random.Generator) -> list[BoardPose]:
    target = site.targets[site.rig.target_of(name)]
    distances = _distances(site, name)
    directions = _directions(site, name, distances)
    reached: list[BoardPose] = []
    beyond: list[BoardPose] = []
    for drawn in range(_DRAWS * count if len(directions) else 0):
        T_root_t = _draw(site, name, directions, distances, rng)
        into = reached if site.in_reach(target, T_root_t) else beyond
        if len(into) < count and site.is_clear(target, T_root_t):
            seen_by = _seen_by(site, target.name, T_root_t)
            if len(seen_by) >= 2 and name in seen_by:
                into.append(BoardPose(target.name, T_root_t, seen_by))
        if len(reached) == count or (drawn == _HOPELESS and not reached and not beyond):
            break
    return reached or beyond


def _distances(site: Site, name: str) -> Array:
    """Nearest and farthest (2,)."""
    diagonal = float(np.linalg.norm(site.targets[site.rig.target_of(name)].size))
    extent = float(np.linalg.norm(np.ptp(site.places, axis=0)))
    return np.array([_NEAR * diagonal, max(_FAR * diagonal, _FAR_OF_RIG * extent)])


def _directions(site: Site, name: str, distances: Array) -> Array:
    """(N, 3) unit directions in the sensor's frame in which it sees, near, far, or between."""
    kind, config = site.kinds[name], site.rig.sensors[name]
    d_s = circle(_DIRECTIONS) if kind.flat else sphere(_DIRECTIONS)
    if kind.sees is None:
        return d_s
    at = np.geomspace(distances[0], distances[1], 4)
    result: Array = d_s[np.any([kind.sees(r * d_s, config) for r in at], axis=0)]
    return result


def _draw(
    site: Site, name: str, directions: Array, distances: Array, rng: np.random.Generator
) -> Array:
    """`T_root_t` (4, 4): some point of the board in one of the directions, turned to the sensor."""
    near, far = distances
    target, T_root_s = site.targets[site.rig.target_of(name)], site.T_root_s[name]
    away = T_root_s[:3, :3] @ directions[rng.integers(len(directions))]
    place = T_root_s[:3, 3] + near * (far / near) ** rng.uniform() * away
    R = facing(away, site.up, rng.uniform(-_MOST_RPY_DEG, _MOST_RPY_DEG))
    shift = np.append(rng.uniform(-_SHIFT, _SHIFT, 2) * target.size, 0.0)
    return se3.transform(R, place + R @ shift)


def _seen_by(site: Site, target: str, T_root_t: Array) -> tuple[str, ...]:
    return tuple(
        name
        for name, config in site.rig.sensors.items()
        if site.rig.target_of(name) == target and can_be_planned(site.kinds[name])
        for T_s_t in [se3.inverse(site.T_root_s[name]) @ T_root_t]
        if len(spots_in_view(T_s_t, site.kinds[name], config, site.targets[target]))
    )
