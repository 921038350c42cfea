"""The door for plugins: all that they implement, are given, and hand back.

Names are imported when they are first used: a plugin that offers a command must not load numpy.
Geometry (`rigcal.geometry`), default residuals (`rigcal.residual`) and messages of ROS
(`rigcal.recording.ros`) are there to be used as well.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rigcal.plugin.hookspecs import hookimpl

if TYPE_CHECKING:
    from rigcal.calibration import Calibration
    from rigcal.errors import InputError, ObservationError, RecordingError
    from rigcal.exporting.exporter import Exported, Exporter
    from rigcal.geometry.se3 import Array
    from rigcal.importing.importer import Imported, Importer
    from rigcal.observation import (
        Candidate,
        Detection,
        LineGeometry,
        MeanGeometry,
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
    from rigcal.plugin.offer import Command, FileSchema
    from rigcal.plugin.refinable import Parameters, Refinable, RefinableResidual
    from rigcal.plugin.registry import BrokenPlugin, Plugin, Registry
    from rigcal.recording.format import RecordingFormat
    from rigcal.recording.message import Definitions, Message, Recording, Source
    from rigcal.rig import Rig
    from rigcal.scene import Scene
    from rigcal.targets import Patch, Target, TargetConfig, TargetType

_HOMES = {
    "calibration": ("Calibration",),
    "errors": ("InputError", "ObservationError", "RecordingError"),
    "exporting.exporter": ("Exported", "Exporter"),
    "geometry.se3": ("Array",),
    "importing.importer": ("Imported", "Importer"),
    "observation": (
        "Candidate",
        "Detection",
        "LineGeometry",
        "MeanGeometry",
        "PlaneGeometry",
        "PointGeometry",
        "PoseGeometry",
    ),
    "plugin.offer": ("Command", "FileSchema"),
    "plugin.refinable": ("Parameters", "Refinable", "RefinableResidual"),
    "plugin.registry": ("BrokenPlugin", "Plugin", "Registry"),
    "recording.format": ("RecordingFormat",),
    "recording.message": ("Definitions", "Message", "Recording", "Source"),
    "rig": ("Rig",),
    "scene": ("Scene",),
    "targets": ("Patch", "Target", "TargetConfig", "TargetType"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "CONTRACT_VERSION",
    "Array",
    "BrokenPlugin",
    "Calibration",
    "Candidate",
    "Command",
    "Definitions",
    "Detection",
    "Effects",
    "Exported",
    "Exporter",
    "FileSchema",
    "FrameView",
    "Imported",
    "Importer",
    "InputError",
    "LineGeometry",
    "MeanGeometry",
    "Message",
    "ObservationError",
    "Parameters",
    "Patch",
    "PlaneGeometry",
    "Plugin",
    "PointGeometry",
    "PoseConfig",
    "PoseGeometry",
    "Recording",
    "RecordingError",
    "RecordingFormat",
    "Refinable",
    "RefinableResidual",
    "Registry",
    "Residual",
    "Rig",
    "Scene",
    "SensorConfig",
    "SensorType",
    "Source",
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
