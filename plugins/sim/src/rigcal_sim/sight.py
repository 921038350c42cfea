"""Which sensors of a rig have the board in view."""

from __future__ import annotations

from collections.abc import Mapping

from rigcal import visibility
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.plugin import Registry
from rigcal.rig import Rig, T_root_sensors
from rigcal.targets import Target
from rigcal_sim.scenario import ScenarioConfig


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
        if rig.target_of(name) != target.name:
            continue
        T_s_t = se3.inverse(T_w_s[name]) @ T_w_t
        spots = visibility.spots_in_view(T_s_t, registry.sensor_type(config.type), config, target)
        if len(spots):
            found[name] = spots
    return found
