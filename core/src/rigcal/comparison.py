"""Which sensor moved: two calibrations of one rig, against their uncertainties."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rigcal.calibration import Calibration, SensorResult
from rigcal.errors import ConfigError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.rig import Rig, T_root_sensors

LIMIT_SIGMAS = float(np.sqrt(22.4577 / 6))
"""A sensor that stood still is beyond it once in 1000 times: the 99.9 % point of chi-square with 6
degrees of freedom, per degree.
"""


@dataclass(frozen=True, eq=False)
class Change:
    """How one sensor's pose differs.

    `T_before_after` (4, 4) is in the sensor's own frame, as it was before. `sigmas` is
    sqrt(xi^T C^-1 xi / 6) with xi = Log(T_before_after) and C the sum of both covariances: 1 (rms)
    for a sensor that stood still; None if neither calibration has a covariance.
    """

    T_before_after: Array
    sigmas: float | None

    @property
    def translation_m(self) -> float:
        """How far it is from where it was."""
        return float(np.linalg.norm(self.T_before_after[:3, 3]))

    @property
    def rotation_rad(self) -> float:
        """The angle by which it is turned."""
        return float(se3.rotation_angle(self.T_before_after[:3, :3]))

    @property
    def moved(self) -> bool:
        """Whether the uncertainties do not explain it (`LIMIT_SIGMAS`)."""
        return self.sigmas is not None and self.sigmas > LIMIT_SIGMAS


@dataclass(frozen=True)
class Comparison:
    """Changes of all shared sensors, seen from one that stood still: `reference`."""

    reference: str
    sensors: Mapping[str, Change]
    only_before: tuple[str, ...]
    only_after: tuple[str, ...]

    @property
    def moved(self) -> tuple[str, ...]:
        """The sensors that moved."""
        return tuple(name for name, change in self.sensors.items() if change.moved)


def compare(before: Calibration, after: Calibration) -> Comparison:
    """What changed between two calibrations of one rig from recordings of their own.

    Poses are relative: if one sensor is moved, all others have moved as seen from it. The reference
    is `before.root`, unless most moved as seen from it: then the sensor as seen from which the
    fewest did. With two sensors it cannot be told which one it was. What a calibration has no
    covariance for counts as exact. ConfigError if they share fewer than two sensors, or for a
    covariance that is none.
    """
    shared = [name for name in before.sensors if name in after.sensors]
    if len(shared) < 2:
        raise ConfigError(
            f"nothing to compare: one calibration has {', '.join(before.sensors)}, the other "
            f"{', '.join(after.sensors)}; they share {', '.join(shared) or 'no sensor'}"
        )
    if before.root in shared:
        shared.insert(0, shared.pop(shared.index(before.root)))
    reference = shared[0]
    seen_from = {reference: _changes(before, after, reference, shared)}
    if 2 * _count_moved(seen_from[reference]) > len(shared) - 1:
        seen_from |= {name: _changes(before, after, name, shared) for name in shared[1:]}
        reference = min(shared, key=lambda name: _count_moved(seen_from[name]))
    return Comparison(
        reference,
        seen_from[reference],
        tuple(name for name in before.sensors if name not in after.sensors),
        tuple(name for name in after.sensors if name not in before.sensors),
    )


def calibration_of_poses(rig: Rig) -> Calibration:
    """The poses that a rig file gives its sensors, to be compared with; without covariances.

    ConfigError names the sensors that no pose connects to the root.
    """
    poses = T_root_sensors(rig)
    return Calibration(rig.root, {name: SensorResult(rig.root, T) for name, T in poses.items()})


def _changes(
    before: Calibration, after: Calibration, reference: str, names: list[str]
) -> dict[str, Change]:
    result = {}
    for name in names:
        if name == reference:
            continue
        T_before_after = se3.inverse(before.T(reference, name)) @ after.T(reference, name)
        C = _covariance(before, reference, name) + _covariance(after, reference, name)
        result[name] = Change(T_before_after, _sigmas(T_before_after, C, name))
    return result


def _count_moved(changes: Mapping[str, Change]) -> int:
    return sum(change.moved for change in changes.values())


def _sigmas(T: Array, C: Array, name: str) -> float | None:
    if not C.any():
        return None
    try:
        whitened = np.linalg.solve(np.linalg.cholesky(C), se3.log(T))
    except np.linalg.LinAlgError:
        raise ConfigError(f"the covariance of sensor '{name}' is not positive definite") from None
    return float(np.sqrt(np.mean(whitened**2)))


def _covariance(calibration: Calibration, reference: str, name: str) -> Array:
    """(6, 6) of `T_reference_name`, in the frame of `name`.

    Where only covariances of single sensors are known they are taken as independent, which is on
    the safe side: what both saw together errs alike.
    """
    if calibration.joint_covariance is not None:
        return calibration.covariance(reference, name)
    M = se3.adjoint(calibration.T(name, reference))
    C = _in_root(calibration, name) + M @ _in_root(calibration, reference) @ M.T
    return (C + C.T) / 2


def _in_root(calibration: Calibration, name: str) -> Array:
    """(6, 6) covariance of `T_root_name`: those along the chain of parents, in the last frame."""
    total = np.zeros((6, 6))
    at = name
    while at != calibration.root:
        own = calibration.sensors[at]
        if own.covariance is not None:
            M = se3.adjoint(calibration.T(name, at))
            total += M @ own.covariance @ M.T
        at = own.parent
    return total
