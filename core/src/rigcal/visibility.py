"""Which part of the target a sensor has in view."""

from __future__ import annotations

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.plugin.contract import SensorConfig, SensorType
from rigcal.targets.target import Target

_LEAST_SEEN = 0.5
_LEAST_CHORD = 0.25
_STEPS = np.linspace(-0.5, 0.5, 5)


def spots_in_view(T_s_t: Array, kind: SensorType, config: SensorConfig, target: Target) -> Array:
    """Points (N, 3) of the target, in the sensor's frame and view; N = 0 where it sees too little.

    It must have at least half of the target in view, and look at its face. Of a target that a flat
    sensor sees, it is half of the line in which its plane cuts it; a cut shorter than a quarter of
    the target's shorter side is none.
    """
    if T_s_t[:3, 2] @ T_s_t[:3, 3] >= 0:
        return np.empty((0, 3))
    spots = cut(T_s_t, target) if kind.flat else _spots(T_s_t, target)
    seen = np.ones(len(spots), bool) if kind.sees is None else kind.sees(spots, config)
    if not len(spots) or np.mean(seen) < _LEAST_SEEN:
        return np.empty((0, 3))
    result: Array = spots[seen]
    return result


def _spots(T_s_t: Array, target: Target) -> Array:
    """Points (25, 3) all over the board, in the sensor's frame."""
    grid = np.stack(np.meshgrid(_STEPS, _STEPS, [0.0]), axis=-1).reshape(-1, 3)
    return se3.apply(T_s_t, grid * [*target.size, 0.0])


def cut(T_s_t: Array, target: Target) -> Array:
    """Points (5, 3) along the cut of the board with the plane z = 0 of the sensor, or (0, 3)."""
    start = se3.apply(T_s_t, target.outline_points)
    end = np.roll(start, -1, axis=0)
    crosses = (start[:, 2] > 0) != (end[:, 2] > 0)
    if np.count_nonzero(crosses) != 2:
        return np.empty((0, 3))
    start, end = start[crosses], end[crosses]
    share = start[:, 2] / (start[:, 2] - end[:, 2])
    first, last = start + share[:, None] * (end - start)
    if np.linalg.norm(last - first) < _LEAST_CHORD * min(target.size):
        return np.empty((0, 3))
    result: Array = (first + last) / 2 + _STEPS[:, None] * (last - first)
    return result
