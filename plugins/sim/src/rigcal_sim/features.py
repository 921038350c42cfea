"""Observations without raw data: what flawless detectors would report, for studies of estimates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.observation import Observation
from rigcal.plugin.registry import Registry
from rigcal.rig import Rig, build_targets
from rigcal_sim.sampling import sample_board_poses
from rigcal_sim.scenario import ScenarioConfig
from rigcal_sim.sight import sensor_poses


@dataclass(frozen=True, eq=False)
class Features:
    """Observations, at most one candidate each, and the true `T_root_t` (4, 4) per exposure."""

    observations: tuple[Observation, ...]
    T_root_t: dict[str, Array]


def observe_boards(rig: Rig, registry: Registry, scenario: ScenarioConfig, seed: int) -> Features:
    """The boards of a scenario as each sensor observes them, with the configured noise.

    Boards and noise are drawn anew for every seed. The rig has one target, and every type of its
    sensors can `observe`.
    """
    (target,) = build_targets(rig, registry).values()
    T_w_t = sample_board_poses(rig, registry, target, scenario, seed).T_w_t
    T_w_s = sensor_poses(rig, scenario)
    boards = {str(k): T for k, T in enumerate(T_w_t)}
    seen = observe_at(rig, registry, T_w_s, boards, np.random.default_rng(seed))
    T_root_w = se3.inverse(T_w_s[rig.root])
    return Features(seen, {k: T_root_w @ T for k, T in boards.items()})


def observe_at(
    rig: Rig,
    registry: Registry,
    T_w_s: Mapping[str, Array],
    T_w_t: Mapping[str, Array],
    rng: np.random.Generator,
) -> tuple[Observation, ...]:
    """The board at poses (4, 4) by exposure as each sensor observes it, with the configured noise.

    As for `observe_boards`; w is any frame.
    """
    (target,) = build_targets(rig, registry).values()
    observations = []
    for k, T in T_w_t.items():
        for name, config in rig.sensors.items():
            observe = registry.sensor_type(config.type).observe
            assert observe is not None, f"{config.type} cannot observe without raw data"
            candidate = observe(se3.inverse(T_w_s[name]) @ T, config, target, rng)
            found = () if candidate is None else (candidate,)
            observations.append(Observation(name, k, 0, f"{name} {k}", found, "not in view"))
    return tuple(observations)


def with_outliers(
    observations: Sequence[Observation], share: float, rng: np.random.Generator
) -> tuple[Observation, ...]:
    """The observations, of every sensor's a share that belongs to other exposures.

    It is as if the detector had taken something else for the board: what a sensor reports is a
    board where none was, of the right kind and with the noise that it states: the one that it sees
    in the next of the exposures that are chosen. At least two of a sensor's observations change
    places, or none.
    """
    changed = list(observations)
    for sensor in dict.fromkeys(o.sensor for o in observations):
        own = [i for i, o in enumerate(observations) if o.sensor == sensor and o.candidates]
        count = round(share * len(own))
        if count < 2:
            continue
        chosen = sorted(rng.permutation(own)[:count].tolist())
        for i, j in zip(chosen, [*chosen[1:], chosen[0]], strict=True):
            changed[i] = replace(observations[i], candidates=observations[j].candidates)
    return tuple(changed)
