"""The door for plugins: what they implement and how they are collected.

Names are imported when they are first used: a plugin that offers a command must not load numpy.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rigcal.plugin.hookspecs import hookimpl

if TYPE_CHECKING:
    from rigcal.plugin.contract import (
        CONTRACT_VERSION,
        Effects,
        FrameView,
        PoseConfig,
        Residual,
        SensorConfig,
        SensorType,
        StackableResidual,
    )
    from rigcal.plugin.registry import BrokenPlugin, Plugin, Registry

_REGISTRY = ("BrokenPlugin", "Plugin", "Registry")

__all__ = [
    "CONTRACT_VERSION",
    "BrokenPlugin",
    "Effects",
    "FrameView",
    "Plugin",
    "PoseConfig",
    "Registry",
    "Residual",
    "SensorConfig",
    "SensorType",
    "StackableResidual",
    "hookimpl",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'rigcal.plugin' has no attribute '{name}'")
    home = "registry" if name in _REGISTRY else "contract"
    return getattr(import_module(f"rigcal.plugin.{home}"), name)
