"""calibration.yaml and truth.yaml: a `Calibration` as a file that people and programs read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
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
from rigcal.calibration_text import CONVENTION, FORMAT, calibration_text
from rigcal.document import Problems, check_format, read_document
from rigcal.files import write_text
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.plugin.contract import RotationConfig
from rigcal.validation import nearest_of

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
    check_format(document, FORMAT, "a calibration")
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
    n = len(joint.rows)
    return JointCovariance(joint.sensors, np.array(joint.rows, np.float64).reshape(n, n))


def save_calibration(path: Path | str, calibration: Calibration) -> None:
    """Write a calibration in one step: the same calibration gives the same bytes."""
    write_text(path, calibration_text(calibration))


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
                found = f"'{name}' is the root: its parent must be '{name}', its pose the identity"
                problems.add(path, f"{found}; correct it, or leave it out")
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
