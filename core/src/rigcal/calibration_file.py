"""calibration.yaml and truth.yaml: a `Calibration` as a file that people and programs read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field

from rigcal.calibration import (
    Calibration,
    GraphError,
    JointCovariance,
    RefinedNumber,
    Rejection,
    ResidualStatistics,
    SensorResult,
)
from rigcal.document import Problems, read_document
from rigcal.files import write_text
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.plugin.contract import RotationConfig
from rigcal.validation import nearest_of

FORMAT, VERSION = "rigcal-calibration", 1
CONVENTION = (
    "T_parent_sensor: p_parent = R p_sensor + t; "
    "covariance over [rotation rad, translation m], right perturbation, sensor frame"
)
_SIX = Field(min_length=6, max_length=6)


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class _Translation(_Model):
    x: float
    y: float
    z: float


class _Pose(_Model):
    translation_m: _Translation
    rotation: RotationConfig

    @property
    def T(self) -> Array:
        t, q = self.translation_m, self.rotation
        R = se3.rotation_from_quaternion(np.array([q.x, q.y, q.z, q.w]))
        return se3.transform(R, np.array([t.x, t.y, t.z]))


class _Residual(_Model):
    unit: str
    rms: float
    count: int


class _Refined(_Model):
    value: float
    sigma: float
    start: float
    unit: str = ""


class _Sensor(_Pose):
    parent: str
    covariance: Annotated[list[Annotated[list[float], _SIX]], _SIX] | None = None
    observations: int | None = None
    inliers: int | None = None
    residual: _Residual | None = None
    noise_scale: float | None = None
    refined: dict[str, _Refined] = {}
    sigma: dict[Literal["configured", "estimated"], Annotated[list[float], _SIX]] = {}

    def result(self) -> SensorResult:
        return SensorResult(
            parent=self.parent,
            T_parent_sensor=self.T,
            covariance=None if self.covariance is None else np.array(self.covariance),
            observations=self.observations,
            inliers=self.inliers,
            residual=ResidualStatistics(**dict(self.residual)) if self.residual else None,
            noise_scale=self.noise_scale,
            refined=_refined(self.refined),
            sigmas={how: np.array(sigma) for how, sigma in self.sigma.items()},
        )


class _Target(_Model):
    refined: dict[str, _Refined] = {}


def _refined(numbers: Mapping[str, _Refined]) -> dict[str, RefinedNumber]:
    return {name: RefinedNumber(**dict(number)) for name, number in numbers.items()}


class _Rejection(_Model):
    sensor: str
    exposure: str
    origin: str
    reason: str


class _Hold(_Model):
    start_ns: int
    end_ns: int


class _GraphError(_Model):
    pairwise_m2: float
    solution_m2: float
    edges: int


class _JointCovariance(_Model):
    sensors: tuple[str, ...]
    rows: list[list[float]]


class _File(_Model):
    format: Literal["rigcal-calibration"]
    version: Literal[1]
    root: str
    convention: str = CONVENTION
    sensors: dict[str, _Sensor] = Field(min_length=1)
    targets: dict[str, _Target] = {}
    rejected: tuple[_Rejection, ...] = ()
    warnings: tuple[str, ...] = ()
    graph_error: _GraphError | None = None
    provenance: dict[str, Any] = {}
    target_poses: dict[str, _Pose] = {}
    holds: dict[str, _Hold] = {}
    joint_covariance: _JointCovariance | None = None


def load_calibration(path: Path | str) -> Calibration:
    """The calibration in a file; any tree is accepted, and the root may be left out of `sensors`.

    ConfigError with file, line and key for all that is wrong in it.
    """
    document = read_document(path, "a calibration")
    problems = Problems(document)
    file = problems.validate(_File, document.data)
    if file is not None:
        _check_tree(problems, file)
    problems.raise_if_any()
    assert file is not None  # it is None only with a problem noted
    sensors = {name: sensor.result() for name, sensor in file.sensors.items()}
    sensors.setdefault(file.root, SensorResult(file.root, np.eye(4)))
    return Calibration(
        root=file.root,
        sensors=sensors,
        target_poses={name: pose.T for name, pose in file.target_poses.items()},
        holds_ns={name: (hold.start_ns, hold.end_ns) for name, hold in file.holds.items()},
        rejected=tuple(Rejection(**dict(rejection)) for rejection in file.rejected),
        warnings=file.warnings,
        provenance=file.provenance,
        graph_error=GraphError(**dict(file.graph_error)) if file.graph_error else None,
        joint_covariance=_joint(file.joint_covariance) if file.joint_covariance else None,
        refined_targets={name: _refined(t.refined) for name, t in file.targets.items()},
    )


def _joint(joint: _JointCovariance) -> JointCovariance:
    return JointCovariance(joint.sensors, np.array(joint.rows).reshape(len(joint.rows), -1))


def save_calibration(path: Path | str, calibration: Calibration) -> None:
    """Write a calibration in one step: the same calibration gives the same bytes."""
    write_text(path, calibration_text(calibration))


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


def _check_tree(problems: Problems, file: _File) -> None:
    """Every sensor hangs from the root, and every covariance is one."""
    parents = {name: sensor.parent for name, sensor in file.sensors.items()}
    known = list(dict.fromkeys([file.root, *parents]))
    for name, sensor in file.sensors.items():
        path = ("sensors", name)
        chain = [name]
        while chain[-1] != file.root and (up := parents.get(chain[-1])) and up not in chain:
            chain.append(up)
        if name == file.root:
            if sensor.parent != name or not np.allclose(sensor.T, np.eye(4), atol=1e-9):
                problems.add(path, f"the root has itself as parent, without any motion: '{name}'")
        elif sensor.parent not in known:
            found = f"no sensor '{sensor.parent}'{nearest_of(sensor.parent, known)}"
            problems.add((*path, "parent"), found)
        elif chain[-1] != file.root and chain[-1] in known:
            problems.add((*path, "parent"), f"its parents do not lead to the root '{file.root}'")
        if sensor.covariance is not None:
            _check_covariance(problems, (*path, "covariance"), np.array(sensor.covariance))
    if file.joint_covariance is not None:
        _check_joint(problems, known, file.joint_covariance)


def _check_joint(problems: Problems, known: list[str], joint: _JointCovariance) -> None:
    path, size = ("joint_covariance", "rows"), 6 * len(joint.sensors)
    unknown = [name for name in joint.sensors if name not in known]
    if unknown:
        problems.add(("joint_covariance", "sensors"), f"no sensor '{unknown[0]}'")
    if len(joint.rows) != size or any(len(row) != size for row in joint.rows):
        problems.add(path, f"expected {size} rows of {size} numbers, six for each sensor")
    elif size:
        _check_covariance(problems, path, np.array(joint.rows))


def _check_covariance(problems: Problems, path: tuple[str, ...], covariance: Array) -> None:
    deviation = np.sqrt(np.abs(np.diag(covariance))) + 1e-300
    scaled = covariance / np.outer(deviation, deviation)
    if not np.allclose(scaled, scaled.T, atol=1e-6):
        problems.add(path, "the matrix is not symmetric, as a covariance is")
    elif np.linalg.eigvalsh(scaled)[0] < -1e-6:
        problems.add(path, "the matrix has a negative eigenvalue, which no covariance has")


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
