"""The door for plugins: all that they implement, are given, and hand back.

Names are imported when they are first used: a plugin that offers a command must not load numpy.
Geometry (`rigcal.geometry`), default residuals (`rigcal.residual`) and messages of ROS
(`rigcal.recording.ros`) are there to be used as well.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rigcal.plugin.hookspecs import hookimpl

if TYPE_CHECKING:
    from rigcal.errors import ObservationError, RecordingError
    from rigcal.geometry.se3 import Array
    from rigcal.observation import (
        Candidate,
        Detection,
        LineGeometry,
        PlaneGeometry,
        PointGeometry,
        PoseGeometry,
    )
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
    from rigcal.recording.message import Message
    from rigcal.scene import Scene
    from rigcal.targets import Target, TargetConfig, TargetType

_HOMES = {
    "errors": ("ObservationError", "RecordingError"),
    "geometry.se3": ("Array",),
    "observation": (
        "Candidate",
        "Detection",
        "LineGeometry",
        "PlaneGeometry",
        "PointGeometry",
        "PoseGeometry",
    ),
    "plugin.registry": ("BrokenPlugin", "Plugin", "Registry"),
    "recording.message": ("Message",),
    "scene": ("Scene",),
    "targets": ("Target", "TargetConfig", "TargetType"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "CONTRACT_VERSION",
    "Array",
    "BrokenPlugin",
    "Candidate",
    "Detection",
    "Effects",
    "FrameView",
    "LineGeometry",
    "Message",
    "ObservationError",
    "PlaneGeometry",
    "Plugin",
    "PointGeometry",
    "PoseConfig",
    "PoseGeometry",
    "RecordingError",
    "Registry",
    "Residual",
    "Scene",
    "SensorConfig",
    "SensorType",
    "StackableResidual",
    "Target",
    "TargetConfig",
    "TargetType",
    "hookimpl",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'rigcal.plugin' has no attribute '{name}'")
    return getattr(import_module(f"rigcal.{_HOME_OF.get(name, 'plugin.contract')}"), name)
