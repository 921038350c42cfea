"""The door for plugins: what they implement and how they are collected."""

from rigcal.plugin.contract import (
    CONTRACT_VERSION,
    PoseConfig,
    Residual,
    SensorConfig,
    SensorType,
)
from rigcal.plugin.hookspecs import hookimpl

__all__ = [
    "CONTRACT_VERSION",
    "PoseConfig",
    "Residual",
    "SensorConfig",
    "SensorType",
    "hookimpl",
]
