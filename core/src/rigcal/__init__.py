"""Extrinsic calibration of any mix of cameras, laser range finders and other sensors.

Everything that the command line does is a call:

    registry = rigcal.Registry.from_entry_points()
    rig = rigcal.load_rig("rig.yaml", registry)
    observations = rigcal.detect(rig, registry, "recording.mcap")
    calibration = rigcal.calibrate(rig, registry, observations)
    rigcal.save_calibration("calibration.yaml", calibration)

No call prints, exits or keeps global state. Names are imported when they are first used: listing
plugins must not load the numerical libraries.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rigcal.calibration import Calibration, SensorResult
    from rigcal.calibration_file import load_calibration, save_calibration
    from rigcal.detection import detect
    from rigcal.errors import RigcalError
    from rigcal.estimation import calibrate
    from rigcal.evaluation import Evaluation, evaluate
    from rigcal.exporting import export, write_export
    from rigcal.graph.method import Method
    from rigcal.observation import Observation
    from rigcal.observation_file import load_observations, save_observations
    from rigcal.plugin.registry import Registry
    from rigcal.printing import write_target_page
    from rigcal.report import write_report
    from rigcal.rig import Rig, build_targets, load_rig, parse_rig
    from rigcal.skeleton import new_plugin

_HOME = {
    "Calibration": "calibration",
    "Evaluation": "evaluation",
    "Method": "graph.method",
    "Observation": "observation",
    "Registry": "plugin.registry",
    "Rig": "rig",
    "RigcalError": "errors",
    "SensorResult": "calibration",
    "build_targets": "rig",
    "calibrate": "estimation",
    "detect": "detection",
    "evaluate": "evaluation",
    "export": "exporting",
    "load_calibration": "calibration_file",
    "load_observations": "observation_file",
    "load_rig": "rig",
    "new_plugin": "skeleton",
    "parse_rig": "rig",
    "save_calibration": "calibration_file",
    "save_observations": "observation_file",
    "write_export": "exporting",
    "write_report": "report",
    "write_target_page": "printing",
}

__all__ = [
    "Calibration",
    "Evaluation",
    "Method",
    "Observation",
    "Registry",
    "Rig",
    "RigcalError",
    "SensorResult",
    "build_targets",
    "calibrate",
    "detect",
    "evaluate",
    "export",
    "load_calibration",
    "load_observations",
    "load_rig",
    "new_plugin",
    "parse_rig",
    "save_calibration",
    "save_observations",
    "write_export",
    "write_report",
    "write_target_page",
]
__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"rigcal.{_HOME[name]}"), name)
    raise AttributeError(f"module 'rigcal' has no attribute '{name}'")
