"""A scenario for rigs that come without one: boards where the rig's sensors look."""

from __future__ import annotations

import numpy as np

from rigcal.errors import ConfigError
from rigcal.plugin import Registry
from rigcal.rig import Rig
from rigcal.targets import Target
from rigcal_sim.boards import CoverConfig
from rigcal_sim.sampling import sample_board_poses
from rigcal_sim.scenario import RoomConfig, RootPoseConfig, ScenarioConfig
from rigcal_sim.section import Triple
from rigcal_sim.sight import sensor_poses

# The root's axes may be x forward, z up, or a camera's: z forward, y down.
_ROOT_RPY_DEG: tuple[Triple, ...] = ((0.0, 0.0, 0.0), (-90.0, 0.0, -90.0))
_TRIAL_POSES = 4


def default_scenario(rig: Rig, registry: Registry, target: Target) -> ScenarioConfig:
    """40 poses that cover the sensors' views, in a room, with somebody who holds the board.

    The root's z axis is up, or its -y axis: whichever lets more poses be used. ConfigError if no
    two sensors look at a common place.
    """
    usable = []
    for rpy_deg in _ROOT_RPY_DEG:
        scenario = _scenario(rig, target, rpy_deg)
        try:
            trial = sample_board_poses(rig, registry, target, scenario, 0, _TRIAL_POSES)
        except ConfigError:
            continue
        usable.append((trial.redrawn, scenario))
    if usable:
        return min(usable, key=lambda found: found[0])[1]
    raise ConfigError(
        f"no two sensors of rig '{rig.name}' see the board at a common place: check the poses of "
        "its sensors, or give a scenario file"
    )


def _scenario(rig: Rig, target: Target, rpy_deg: Triple) -> ScenarioConfig:
    board = CoverConfig(mode="cover")
    scenario = ScenarioConfig(
        board=board,
        root_pose=RootPoseConfig(rpy_deg=rpy_deg),
        floor_m=-1.2,
        person=True,
    )
    places = [T[:2, 3] for T in sensor_poses(rig, scenario).values()]
    reach = float(np.abs(places).max()) + board.distances_m(target)[1] + 2.0
    # Walls at unlike distances, so that none stands where its image would.
    room = RoomConfig(size_m=(2 * reach, 2 * reach - 0.7, 3.2))
    return scenario.model_copy(update={"room": room})
