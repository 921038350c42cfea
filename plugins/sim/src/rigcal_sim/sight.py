"""Which sensors of a rig have the board in view."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.plugin import Registry
from rigcal.rig import Rig, T_root_sensors
from rigcal.targets import Target
from rigcal_sim.scenario import ScenarioConfig

_LEAST_SEEN = 0.5
_LEAST_CHORD = 0.25
_STEPS = np.linspace(-0.5, 0.5, 5)


def sensor_poses(rig: Rig, scenario: ScenarioConfig) -> dict[str, Array]:
    """`T_w_s` (4, 4) of every sensor; ConfigError if the rig's poses do not connect them."""
    T_w_root = scenario.root_pose.T_w_root
    return {name: T_w_root @ T for name, T in T_root_sensors(rig).items()}


def sensors_that_see(
    rig: Rig, registry: Registry, target: Target, T_w_t: Array, T_w_s: Mapping[str, Array]
) -> tuple[str, ...]:
    """The sensors that have at least half of the board in their view and look at its face.

    Of a board that a flat sensor sees, it is half of the line in which its plane cuts the board;
    a cut shorter than a quarter of the board's shorter side is none.
    """
    return tuple(spots_in_view(rig, registry, target, T_w_t, T_w_s))


def spots_in_view(
    rig: Rig, registry: Registry, target: Target, T_w_t: Array, T_w_s: Mapping[str, Array]
) -> dict[str, Array]:
    """Points (N, 3) of the board, in the sensor's frame and view, by the sensors that see it."""
    found = {}
    for name, config in rig.sensors.items():
        T_s_t = se3.inverse(T_w_s[name]) @ T_w_t
        if rig.target_of(name) != target.name or T_s_t[:3, 2] @ T_s_t[:3, 3] >= 0:
            continue
        kind = registry.sensor_type(config.type)
        spots = _cut(T_s_t, target) if kind.flat else _spots(T_s_t, target)
        seen = np.ones(len(spots), bool) if kind.sees is None else kind.sees(spots, config)
        if len(spots) and np.mean(seen) >= _LEAST_SEEN:
            found[name] = spots[seen]
    return found


def _spots(T_s_t: Array, target: Target) -> Array:
    """Points (25, 3) all over the board, in the sensor's frame."""
    grid = np.stack(np.meshgrid(_STEPS, _STEPS, [0.0]), axis=-1).reshape(-1, 3)
    return se3.apply(T_s_t, grid * [*target.size, 0.0])


def _cut(T_s_t: Array, target: Target) -> Array:
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
