"""How far a calibration is from the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rigcal.calibration import Calibration
from rigcal.errors import ConfigError
from rigcal.geometry import se3


@dataclass(frozen=True)
class SensorError:
    """Error of one sensor's pose in the root.

    `nees` is xi^T C^-1 xi with T_true = T_estimated exp(xi), in the sensor's parent, where the
    covariance C is stated: 6 on average if C is honest (Bar-Shalom, Li, Kirubarajan, "Estimation
    with Applications to Tracking and Navigation", 2001, section 5.4); None without covariance.
    """

    translation_m: float
    rotation_rad: float
    nees: float | None

    @property
    def sigmas(self) -> float | None:
        """The error in standard deviations, 1 (rms) if the covariance is honest."""
        return None if self.nees is None else float(np.sqrt(self.nees / 6))


@dataclass(frozen=True)
class Evaluation:
    """Errors of all sensors but the root, both trees laid on each other at `root`.

    Means over sensors of translation and angle are the metrics of MSG-Cal (IROS 2015). Its angle is
    between principal axes; here it is the whole rotation's, which is never smaller.
    """

    root: str
    sensors: Mapping[str, SensorError]
    only_in_calibration: tuple[str, ...]
    only_in_truth: tuple[str, ...]

    @property
    def mean_translation_m(self) -> float:
        """Mean over sensors."""
        return float(np.mean([error.translation_m for error in self.sensors.values()]))

    @property
    def mean_rotation_rad(self) -> float:
        """Mean over sensors."""
        return float(np.mean([error.rotation_rad for error in self.sensors.values()]))

    @property
    def rms_translation_m(self) -> float:
        """Root mean square over sensors."""
        return float(np.sqrt(np.mean([e.translation_m**2 for e in self.sensors.values()])))

    @property
    def rms_rotation_rad(self) -> float:
        """Root mean square over sensors."""
        return float(np.sqrt(np.mean([e.rotation_rad**2 for e in self.sensors.values()])))


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
    )


def _error(calibration: Calibration, truth: Calibration, name: str) -> SensorError:
    T, T_true = (tree.T(calibration.root, name) for tree in (calibration, truth))
    return SensorError(
        translation_m=float(np.linalg.norm(T[:3, 3] - T_true[:3, 3])),
        rotation_rad=float(se3.rotation_angle(T_true[:3, :3].T @ T[:3, :3])),
        nees=_nees(calibration, truth, name),
    )


def _nees(calibration: Calibration, truth: Calibration, name: str) -> float | None:
    result = calibration.sensors[name]
    if result.covariance is None or result.parent not in truth.sensors:
        return None
    xi = se3.log(se3.inverse(result.T_parent_sensor) @ truth.T(result.parent, name))
    try:
        return float(np.sum(np.linalg.solve(np.linalg.cholesky(result.covariance), xi) ** 2))
    except np.linalg.LinAlgError:
        raise ConfigError(f"the covariance of sensor '{name}' is not positive definite") from None
