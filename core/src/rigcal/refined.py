"""A rig and its targets with the numbers that a calibration refined."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rigcal.calibration import Calibration, RefinedNumber, SensorResult
from rigcal.plugin.contract import SensorConfig, SensorType
from rigcal.plugin.registry import Registry
from rigcal.rig import Rig
from rigcal.targets.target import Target


def as_refined(config: SensorConfig, kind: SensorType, result: SensorResult) -> SensorConfig:
    """A sensor's config with the numbers that its calibration refined; it asks for no more."""
    for name in config.refine if result.refined else ():
        refinable = kind.refinable[name]
        values = np.array([result.refined[n].value for n in refinable.parameters(config).names])
        config = refinable.apply(config, values)
    return config.model_copy(update={"refine": ()})


def rig_as_refined(rig: Rig, registry: Registry, calibration: Calibration) -> Rig:
    """The rig with the numbers that a calibration of it refined."""
    found = {
        name: as_refined(rig.sensors[name], registry.sensor_type(rig.sensors[name].type), result)
        for name, result in calibration.sensors.items()
        if result.refined and name in rig.sensors
    }
    return replace(rig, sensors={**rig.sensors, **found})


def as_bent(target: Target, refined: Mapping[str, RefinedNumber]) -> Target:
    """A target bent as its calibration found it, if it was asked for."""
    names = ("bend_x", "bend_y", "bend_xy")
    bend = np.array([refined[name].value for name in names if name in refined])
    return target.bent(bend) if len(bend) else target
