"""When every sensor takes its frames, and where the board is then."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rigcal.geometry.se3 import Array
from rigcal.plugin import Effects
from rigcal.rig import Rig
from rigcal_sim.carry import carry
from rigcal_sim.poses import stream
from rigcal_sim.scenario import ScenarioConfig
from rigcal_sim.timing import ContinuousConfig

Interval = tuple[int, int]


@dataclass(frozen=True, eq=False)
class Shot:
    """Frame `number` of a sensor: the board is at `T_w_t` (4, 4), at or after `exposure`."""

    sensor: str
    number: int
    exposure: int
    T_w_t: Array
    stamp_ns: int


@dataclass(frozen=True, eq=False)
class Plan:
    """Shots by stamp, and from when to when (ns, true time) the board is held at each pose."""

    shots: tuple[Shot, ...]
    holds: tuple[Interval, ...]


def plan_shots(
    rig: Rig, scenario: ScenarioConfig, effects: Mapping[str, Effects], T_w_t: Array, seed: int
) -> Plan:
    """The frames of all sensors while the board is shown at poses (N, 4, 4).

    One frame per pose and sensor, or each sensor at its own rate while the board is carried. A
    stamp is the frame's true time plus the sensor's clock offset and jitter. `effects` are those
    of `sensor_effects`.
    """
    if isinstance(scenario.recording, ContinuousConfig):
        return _continuous(rig, scenario, scenario.recording, effects, T_w_t, seed)
    period_s = scenario.stamps.period_s
    times_s = period_s * np.arange(1.0, len(T_w_t) + 1)
    shots = []
    for name in rig.sensors:
        stamps = _stamps(name, times_s, scenario, effects[name], seed)
        shots += [
            Shot(name, k, k, T, stamp)
            for k, (T, stamp) in enumerate(zip(T_w_t, stamps, strict=True))
        ]
    return Plan(_by_stamp(rig, shots), _holds(scenario, times_s - period_s / 2, period_s))


def _continuous(
    rig: Rig,
    scenario: ScenarioConfig,
    config: ContinuousConfig,
    effects: Mapping[str, Effects],
    T_w_t: Array,
    seed: int,
) -> Plan:
    carrying = carry(T_w_t, config, seed)
    shots = []
    for name in rig.sensors:
        rate_hz = effects[name].rate_hz
        assert rate_hz is not None  # sensor_effects has seen to it
        times_s = np.arange(effects[name].phase_s, carrying.end_s, 1 / rate_hz)
        stamps = _stamps(name, times_s, scenario, effects[name], seed)
        poses, exposures = carrying.at(times_s)
        shots += [
            Shot(name, number, int(exposure), T, stamp)
            for number, (exposure, T, stamp) in enumerate(
                zip(exposures, poses, stamps, strict=True)
            )
        ]
    return Plan(_by_stamp(rig, shots), _holds(scenario, carrying.start_s, config.hold_s))


def _stamps(
    name: str, times_s: Array, scenario: ScenarioConfig, effects: Effects, seed: int
) -> list[int]:
    """Stamps (ns) of a sensor's frames at true times (N,)."""
    jitter_s = scenario.stamps.jitter_of(effects)
    late_s = stream(seed, 0, f"stamps of {name}").uniform(-jitter_s, jitter_s, len(times_s))
    late_s += times_s + effects.clock_offset_s
    start_ns = round(scenario.stamps.start_s * 1e9)
    return [start_ns + late_ns for late_ns in np.rint(late_s * 1e9).astype(np.int64).tolist()]


def _holds(scenario: ScenarioConfig, start_s: Array, hold_s: float) -> tuple[Interval, ...]:
    start_ns = round(scenario.stamps.start_s * 1e9)
    return tuple(
        (start_ns + round(s * 1e9), start_ns + round((s + hold_s) * 1e9)) for s in start_s.tolist()
    )


def _by_stamp(rig: Rig, shots: list[Shot]) -> tuple[Shot, ...]:
    order = {name: i for i, name in enumerate(rig.sensors)}
    return tuple(sorted(shots, key=lambda shot: (shot.stamp_ns, order[shot.sensor])))
