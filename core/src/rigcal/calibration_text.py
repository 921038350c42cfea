"""The YAML text of a calibration: what people and programs read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import yaml

from rigcal.calibration import Calibration, RefinedNumber, SensorResult
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array

FORMAT, VERSION = "rigcal-calibration", 1
CONVENTION = (
    "T_parent_sensor: p_parent = R p_sensor + t; "
    "covariance over [rotation rad, translation m], right perturbation, sensor frame"
)


def calibration_text(calibration: Calibration) -> str:
    """The YAML text of a calibration; numbers have the digits to be read back unchanged."""
    joint = calibration.joint_covariance
    content = {
        "format": FORMAT,
        "version": VERSION,
        "root": calibration.root,
        "convention": CONVENTION,
        "sensors": {name: _sensor(result) for name, result in calibration.sensors.items()},
        "targets": {
            name: {"refined": _numbers(refined)}
            for name, refined in calibration.refined_targets.items()
        },
        "rejected": [_Line(vars(rejection)) for rejection in calibration.rejected],
        "warnings": _Lines(calibration.warnings),
        "graph_error": calibration.graph_error and _Line(vars(calibration.graph_error)),
        "provenance": _plain(calibration.provenance),
        "target_poses": {name: _Line(_pose(T)) for name, T in calibration.target_poses.items()},
        "holds": {
            name: _Line(start_ns=start, end_ns=end)
            for name, (start, end) in calibration.holds_ns.items()
        },
        "joint_covariance": joint
        and {"sensors": list(joint.sensors), "rows": _Lines(joint.matrix.tolist())},
    }
    kept = {key: value for key, value in content.items() if value or key == "sensors"}
    return yaml.dump(
        kept, Dumper=_Dumper, sort_keys=False, default_flow_style=False, width=10**6,
        allow_unicode=True,
    )  # fmt: skip


class _Line(dict[str, Any]):
    """A mapping on one line."""


class _Lines(list[Any]):
    """A list with one item per line."""


class _Dumper(yaml.SafeDumper):
    """Vectors and matrix rows on one line, everything else in blocks; no anchors."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _sequence(dumper: yaml.SafeDumper, data: list[Any]) -> yaml.Node:
    flow = not any(isinstance(item, (dict, list)) for item in data)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", data, flow_style=flow)


def _block(dumper: yaml.SafeDumper, data: list[Any]) -> yaml.Node:
    return dumper.represent_sequence("tag:yaml.org,2002:seq", data, flow_style=False)


def _flow(dumper: yaml.SafeDumper, data: dict[str, Any]) -> yaml.Node:
    return dumper.represent_mapping("tag:yaml.org,2002:map", data, flow_style=True)


def _text(dumper: yaml.SafeDumper, data: str) -> yaml.Node:
    """Names of digits are quoted: YAML 1.2 readers take 0009 for a number."""
    style = "'" if data.replace(".", "").isdigit() else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", data, style=style)


_Dumper.add_representer(str, _text)
_Dumper.add_representer(list, _sequence)
_Dumper.add_representer(_Lines, _block)
_Dumper.add_representer(_Line, _flow)


def _plain(value: Any) -> Any:
    """Provenance as plain strings, numbers, lists and mappings."""
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(inner) for inner in value]
    if isinstance(value, np.generic):
        return value.item()
    return value if value is None or isinstance(value, (bool, int, float)) else str(value)


def _sensor(result: SensorResult) -> dict[str, Any]:
    entry: dict[str, Any] = {"parent": result.parent, **_pose(result.T_parent_sensor)}
    if result.covariance is not None:
        entry["covariance"] = np.asarray(result.covariance, np.float64).tolist()
    entry |= {"observations": result.observations, "inliers": result.inliers}
    if result.residual is not None:
        entry["residual"] = _Line(vars(result.residual))
    entry["noise_scale"] = result.noise_scale
    entry["sigma"] = {how: sigma.tolist() for how, sigma in result.sigmas.items()} or None
    entry["refined"] = _numbers(result.refined) or None
    return {key: value for key, value in entry.items() if value is not None}


def _numbers(refined: Mapping[str, RefinedNumber]) -> dict[str, Any]:
    return {
        name: _Line({key: value for key, value in vars(number).items() if value != ""})
        for name, number in refined.items()
    }


def _pose(T: Array) -> dict[str, Any]:
    t, q = T[:3, 3], se3.quaternion_from_rotation(T[:3, :3])
    return {
        "translation_m": _Line(zip("xyz", map(float, t), strict=True)),
        "rotation": _Line(zip("xyzw", map(float, q), strict=True)),
    }
