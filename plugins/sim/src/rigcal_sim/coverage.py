"""A scenario for rigs that come without one: boards where the rig's sensors look."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rigcal.errors import ConfigError
from rigcal.geometry.se3 import Array
from rigcal.plugin.registry import Registry
from rigcal.rig import Rig
from rigcal.targets import Target
from rigcal_sim.poses import board_pose, sensor_poses, sensors_that_see
from rigcal_sim.scenario import BoardConfig, RoomConfig, RootPoseConfig, ScenarioConfig

_BEARINGS_DEG = tuple(float(b) for b in range(-180, 180, 15))
_RADII_BY_BOARD = (1.5, 2.0, 2.5, 3.5)
# The root's axes may be x forward, z up, or a camera's: z forward, y down.
_ROOT_RPY_DEG = ((0.0, 0.0, 0.0), (-90.0, 0.0, -90.0))
_EXPOSURES = 40


def default_scenario(rig: Rig, registry: Registry, target: Target) -> ScenarioConfig:
    """About 40 exposures at the bearings and radii that at least two of the sensors cover.

    Radii go with the size of the board. ConfigError if no two sensors look at a common place.
    """
    size = float(np.linalg.norm(target.size))
    radii = tuple(round(size * factor, 2) for factor in _RADII_BY_BOARD)
    answers = [
        (covered, rpy)
        for rpy in _ROOT_RPY_DEG
        for covered in [_covered(rig, registry, target, _scenario(radii, rpy))]
    ]
    covered, rpy = max(answers, key=lambda answer: sum(map(len, answer[0].values())))
    common = [b for b in _BEARINGS_DEG if all(b in seen for seen in covered.values())]
    if not common:
        best = max(covered, key=lambda r: len(covered[r]))
        radii, common = (best,), list(covered[best])
    else:
        radii = tuple(covered)
    if not common:
        raise ConfigError(
            f"no two sensors of rig '{rig.name}' see the board at a common place around the root "
            f"'{rig.root}': check the poses of its sensors, or give a scenario file"
        )
    return _scenario(radii, rpy, tuple(common), max(1, _EXPOSURES // (len(common) * len(radii))))


def _scenario(
    radii: tuple[float, ...],
    rpy_deg: tuple[float, float, float],
    bearings: tuple[float, ...] = _BEARINGS_DEG,
    samples: int = 1,
) -> ScenarioConfig:
    side = 2 * max(radii) + 4.0
    return ScenarioConfig(
        board=BoardConfig(
            bearings_deg=bearings, radii_m=radii, samples=samples, height_m=(-0.15, 0.15)
        ),
        root_pose=RootPoseConfig(rpy_deg=rpy_deg),
        floor_m=-1.2,
        room=RoomConfig(size_m=(side, side - 0.7, 3.2)),
        person=True,
    )


def _covered(
    rig: Rig, registry: Registry, target: Target, scenario: ScenarioConfig
) -> Mapping[float, tuple[float, ...]]:
    """Bearings at which at least two sensors see an unrotated board, by radius, if any."""
    T_w_s = sensor_poses(rig, scenario)

    def sensors(bearing: float, radius: float) -> int:
        T_w_t: Array = board_pose(bearing, radius, 0.0, np.zeros(3))
        return len(sensors_that_see(rig, registry, target, T_w_t, T_w_s))

    found = {
        radius: tuple(b for b in _BEARINGS_DEG if sensors(b, radius) >= scenario.min_sensors)
        for radius in scenario.board.radii_m
    }
    return {radius: bearings for radius, bearings in found.items() if bearings} or {
        scenario.board.radii_m[0]: ()
    }
