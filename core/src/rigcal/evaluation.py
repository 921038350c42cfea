"""How far a calibration is from the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rigcal.calibration import Calibration, GraphError
from rigcal.errors import ConfigError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array


@dataclass(frozen=True)
class SensorError:
    """Error of one sensor's pose in the root.

    `nees` is xi^T C^-1 xi with T_true = T_estimated exp(xi), in the sensor's parent, where the
    covariance C is stated: 6 on average if C is honest (Bar-Shalom, Li, Kirubarajan, "Estimation
    with Applications to Tracking and Navigation", 2001, section 5.4); None without covariance.
    `axis_rad` is the angle of MSG-Cal, between the sensor's principal axis as estimated and as it
    is (a geodesic on S^2). The axis is z: a camera looks along it, a scan turns about it. The angle
    never exceeds `rotation_rad`, and does not see turns about z.
    """

    translation_m: float
    rotation_rad: float
    nees: float | None
    axis_rad: float

    @property
    def sigmas(self) -> float | None:
        """The error in standard deviations, 1 (rms) if the covariance is honest."""
        return None if self.nees is None else float(np.sqrt(self.nees / 6))


@dataclass(frozen=True)
class Evaluation:
    """Errors of all sensors but the root, both trees laid on each other at `root`.

    Means over sensors of translation and angle are the metrics of MSG-Cal (IROS 2015), whose angle
    is that between principal axes. `graph_error` is what the calibration's file says of it.
    """

    root: str
    sensors: Mapping[str, SensorError]
    only_in_calibration: tuple[str, ...]
    only_in_truth: tuple[str, ...]
    graph_error: GraphError | None = None

    @property
    def mean_translation_m(self) -> float:
        """Mean over sensors."""
        return float(np.mean([error.translation_m for error in self.sensors.values()]))

    @property
    def mean_rotation_rad(self) -> float:
        """Mean over sensors."""
        return float(np.mean([error.rotation_rad for error in self.sensors.values()]))

    @property
    def mean_axis_rad(self) -> float:
        """Mean over sensors."""
        return float(np.mean([error.axis_rad for error in self.sensors.values()]))

    @property
    def rms_translation_m(self) -> float:
        """Root mean square over sensors."""
        return float(np.sqrt(np.mean([e.translation_m**2 for e in self.sensors.values()])))

    @property
    def rms_rotation_rad(self) -> float:
        """Root mean square over sensors."""
        return float(np.sqrt(np.mean([e.rotation_rad**2 for e in self.sensors.values()])))

    @property
    def rms_axis_rad(self) -> float:
        """Root mean square over sensors."""
        return float(np.sqrt(np.mean([e.axis_rad**2 for e in self.sensors.values()])))


def evaluate(calibration: Calibration, truth: Calibration) -> Evaluation:
    """Compare each `T_root_s` with the truth, at the calibration's root.

    The truth may hang from another sensor; ConfigError if it lacks the calibration's root, or
    shares no other sensor.
    """
    root = calibration.root
    if root not in truth.sensors:
        raise ConfigError(
            f"the calibration's root '{root}' is not in the truth (has: {', '.join(truth.sensors)})"
        )
    shared = [name for name in calibration.sensors if name in truth.sensors and name != root]
    if not shared:
        raise ConfigError(
            f"nothing to compare: the calibration has {', '.join(calibration.sensors)}, "
            f"the truth has {', '.join(truth.sensors)}; they share only the root"
        )
    return Evaluation(
        root=root,
        sensors={name: _error(calibration, truth, name) for name in shared},
        only_in_calibration=tuple(n for n in calibration.sensors if n not in truth.sensors),
        only_in_truth=tuple(n for n in truth.sensors if n not in calibration.sensors),
        graph_error=calibration.graph_error,
    )


def _error(calibration: Calibration, truth: Calibration, name: str) -> SensorError:
    T, T_true = (tree.T(calibration.root, name) for tree in (calibration, truth))
    return SensorError(
        translation_m=float(np.linalg.norm(T[:3, 3] - T_true[:3, 3])),
        rotation_rad=float(se3.rotation_angle(T_true[:3, :3].T @ T[:3, :3])),
        nees=_nees(calibration, truth, name),
        axis_rad=_angle_between(T[:3, 2], T_true[:3, 2]),
    )


def _angle_between(a: Array, b: Array) -> float:
    """Angle (rad) between unit vectors, accurate for small ones."""
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def _nees(calibration: Calibration, truth: Calibration, name: str) -> float | None:
    result = calibration.sensors[name]
    if result.covariance is None or result.parent not in truth.sensors:
        return None
    xi = se3.log(se3.inverse(result.T_parent_sensor) @ truth.T(result.parent, name))
    try:
        return float(np.sum(np.linalg.solve(np.linalg.cholesky(result.covariance), xi) ** 2))
    except np.linalg.LinAlgError:
        raise ConfigError(
            f"the covariance of sensor '{name}' is not positive definite, so that its error cannot "
            "be counted in standard deviations; correct it, or leave it out of the file"
        ) from None
