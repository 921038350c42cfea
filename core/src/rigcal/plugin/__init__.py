"""The door for plugins: what they implement and how they are collected."""

from rigcal.plugin.contract import (
    CONTRACT_VERSION,
    PoseConfig,
    Residual,
    SensorConfig,
    SensorType,
)
from rigcal.plugin.hookspecs import hookimpl
from rigcal.plugin.registry import BrokenPlugin, Plugin, Registry

__all__ = [
    "CONTRACT_VERSION",
    "BrokenPlugin",
    "Plugin",
    "PoseConfig",
    "Registry",
    "Residual",
    "SensorConfig",
    "SensorType",
    "hookimpl",
]
