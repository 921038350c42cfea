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
    from rigcal.comparison import Comparison, calibration_of_poses, compare
    from rigcal.detection import detect
    from rigcal.errors import Cancelled, RigcalError
    from rigcal.estimation import calibrate
    from rigcal.evaluation import Evaluation, evaluate
    from rigcal.exporting import export, write_export
    from rigcal.fusing import Fused, fuse, write_fused
    from rigcal.graph.method import Method
    from rigcal.observation import (
        LineGeometry,
        Observation,
        PlaneGeometry,
        PointGeometry,
        PoseGeometry,
    )
    from rigcal.observation_file import load_observations, save_observations
    from rigcal.observer import Observer
    from rigcal.planning import Plan, Proposal, Sigma, plan
    from rigcal.plugin.registry import Registry
    from rigcal.printing import write_target_page
    from rigcal.progress import Progress
    from rigcal.proposal import propose_rig
    from rigcal.recording.message import Message
    from rigcal.report import (
        show_timeline,
        write_plan_picture,
        write_report,
        write_timeline,
    )
    from rigcal.resampling import Bootstrap, CrossValidation, bootstrap, cross_validate
    from rigcal.rig import Rig, build_targets, load_rig, parse_rig, rig_schema
    from rigcal.second_look import look_again
    from rigcal.skeleton import new_plugin

_HOME = {
    "Bootstrap": "resampling",
    "Calibration": "calibration",
    "Cancelled": "errors",
    "Comparison": "comparison",
    "CrossValidation": "resampling",
    "Evaluation": "evaluation",
    "Fused": "fusing",
    "LineGeometry": "observation",
    "Message": "recording.message",
    "Method": "graph.method",
    "Observation": "observation",
    "Observer": "observer",
    "Plan": "planning",
    "PlaneGeometry": "observation",
    "PointGeometry": "observation",
    "PoseGeometry": "observation",
    "Progress": "progress",
    "Proposal": "planning",
    "Registry": "plugin.registry",
    "Rig": "rig",
    "RigcalError": "errors",
    "SensorResult": "calibration",
    "Sigma": "planning",
    "bootstrap": "resampling",
    "build_targets": "rig",
    "calibrate": "estimation",
    "calibration_of_poses": "comparison",
    "compare": "comparison",
    "cross_validate": "resampling",
    "detect": "detection",
    "evaluate": "evaluation",
    "export": "exporting",
    "fuse": "fusing",
    "load_calibration": "calibration_file",
    "load_observations": "observation_file",
    "load_rig": "rig",
    "look_again": "second_look",
    "new_plugin": "skeleton",
    "parse_rig": "rig",
    "plan": "planning",
    "propose_rig": "proposal",
    "rig_schema": "rig",
    "save_calibration": "calibration_file",
    "save_observations": "observation_file",
    "show_timeline": "report",
    "write_export": "exporting",
    "write_fused": "fusing",
    "write_plan_picture": "report",
    "write_report": "report",
    "write_target_page": "printing",
    "write_timeline": "report",
}

__all__ = [
    "Bootstrap",
    "Calibration",
    "Cancelled",
    "Comparison",
    "CrossValidation",
    "Evaluation",
    "Fused",
    "LineGeometry",
    "Message",
    "Method",
    "Observation",
    "Observer",
    "Plan",
    "PlaneGeometry",
    "PointGeometry",
    "PoseGeometry",
    "Progress",
    "Proposal",
    "Registry",
    "Rig",
    "RigcalError",
    "SensorResult",
    "Sigma",
    "bootstrap",
    "build_targets",
    "calibrate",
    "calibration_of_poses",
    "compare",
    "cross_validate",
    "detect",
    "evaluate",
    "export",
    "fuse",
    "load_calibration",
    "load_observations",
    "load_rig",
    "look_again",
    "new_plugin",
    "parse_rig",
    "plan",
    "propose_rig",
    "rig_schema",
    "save_calibration",
    "save_observations",
    "show_timeline",
    "write_export",
    "write_fused",
    "write_plan_picture",
    "write_report",
    "write_target_page",
    "write_timeline",
]
__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"rigcal.{_HOME[name]}"), name)
    raise AttributeError(f"module 'rigcal' has no attribute '{name}'")
