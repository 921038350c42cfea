"""The errors of what each sensor measured, at the solution, with where they were measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcal.calibration import Calibration
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.selection import misfit
from rigcal.observation import Candidate, Observation
from rigcal.plugin.contract import SensorConfig, SensorType
from rigcal.plugin.registry import Registry
from rigcal.refined import as_bent, as_refined
from rigcal.residual import residual_of
from rigcal.rig import Rig, build_targets
from rigcal.targets.target import Target


@dataclass(frozen=True, eq=False)
class SensorErrors:
    """What one sensor contributed.

    `errors` (N, 1) or (N, 2), unwhitened, in `unit`; `exposure` (N,) is each row's index into
    `exposures`; `points` (N, 3) is where it was measured, in the sensor's frame, if the sensor
    type tells; `target` (K, 4, 4) is the target's pose in the sensor's frame, per exposure.
    `whitened` (M,) are the rows of the residuals: of unit variance if the noise is as configured.
    """

    unit: str
    errors: Array
    exposure: NDArray[np.intp]
    exposures: tuple[str, ...]
    target: Array
    points: Array | None
    whitened: Array

    @property
    def sizes(self) -> Array:
        """(N,) length of each error."""
        result: Array = np.linalg.norm(self.errors, axis=1)
        return result

    @property
    def incidence(self) -> Array:
        """(N,) angle (rad) between line of sight and target's normal; needs `points`."""
        assert self.points is not None
        normals = self.target[self.exposure, :3, 2]
        directions = self.points / np.linalg.norm(self.points, axis=1, keepdims=True)
        result: Array = np.arccos(np.clip(np.abs(np.sum(normals * directions, axis=1)), 0, 1))
        return result


def used(calibration: Calibration, observations: Sequence[Observation]) -> list[Observation]:
    """The observations that the solution rests on; their exposures are named as there."""
    rejected = {(r.sensor, r.exposure) for r in calibration.rejected}
    return [
        o
        for o in observations
        if o.candidates
        and o.exposure in calibration.target_poses
        and (o.sensor, o.exposure) not in rejected
    ]


def errors_by_sensor(
    calibration: Calibration, observations: Sequence[Observation], rig: Rig, registry: Registry
) -> dict[str, SensorErrors]:
    """In the order of the calibration; sensors that contributed nothing are left out."""
    targets, by_sensor = build_targets(rig, registry), dict[str, list[Observation]]()
    for o in used(calibration, observations):
        by_sensor.setdefault(o.sensor, []).append(o)

    def target_of(sensor: str) -> Target:
        name = rig.target_of(sensor)
        return as_bent(targets[name], calibration.refined_targets.get(name, {}))

    return {
        name: _errors_of(
            by_sensor[name],
            registry.sensor_type(rig.sensors[name].type),
            config_of(calibration, rig, registry, name),
            target_of(name),
            [o.exposure for o in by_sensor[name]],
            _poses(calibration, rig, registry, name, by_sensor[name]),
        )
        for name in calibration.sensors
        if name in by_sensor
    }


def config_of(calibration: Calibration, rig: Rig, registry: Registry, sensor: str) -> SensorConfig:
    """A sensor's config with the numbers that the calibration refined."""
    config = rig.sensors[sensor]
    return as_refined(config, registry.sensor_type(config.type), calibration.sensors[sensor])


def _poses(
    calibration: Calibration,
    rig: Rig,
    registry: Registry,
    sensor: str,
    own: Sequence[Observation],
) -> Array:
    """(K, 4, 4) the target in the sensor's frame; of a target whose print was found to be s times
    as large, at 1 / s of the distance for a sensor that measures directions only.
    """
    T_s_root = se3.inverse(calibration.T(calibration.root, sensor))
    T = np.array([calibration.target_poses[o.exposure] for o in own])
    poses: Array = T_s_root @ T
    scale = calibration.refined_targets.get(rig.target_of(sensor), {}).get("scale")
    if scale is not None and registry.sensor_type(rig.sensors[sensor].type).angular:
        poses[:, :3, 3] /= scale.value
    return poses


def _errors_of(
    own: Sequence[Observation],
    kind: SensorType,
    config: SensorConfig,
    target: Target,
    exposures: Sequence[str],
    poses: Array,
) -> SensorErrors:
    raw = kind.errors is not None and not any(c.by_hand for o in own for c in o.candidates)
    measured_at = kind.measured_at if raw else None
    errors, points, whitened = [], [], []
    for o, T_s_t in zip(own, poses, strict=True):
        every = [_errors(kind if raw else None, c, config, target, T_s_t) for c in o.candidates]
        # The solution rests on the one that agrees with it.
        chosen = int(np.argmin([np.median(np.abs(e)) for e in every]))
        candidate = o.candidates[chosen]
        errors.append(every[chosen])
        whitened.append(residual_of(kind, candidate, config, target)(T_s_t)[0])
        if measured_at is not None:
            points.append(measured_at(candidate, config, target, T_s_t))
    return SensorErrors(
        kind.unit if raw else "m",
        np.concatenate(errors),
        np.repeat(np.arange(len(own)), [len(e) for e in errors]),
        tuple(exposures),
        poses,
        np.concatenate(points) if points else None,
        np.concatenate(whitened),
    )


def _errors(
    kind: SensorType | None, candidate: Candidate, config: object, target: Target, T_s_t: Array
) -> Array:
    """(N, 1) or (N, 2), by the sensor type or, where it has none, one of the geometry."""
    if kind is None or kind.errors is None:
        return np.array([[misfit(candidate.geometry, T_s_t, target)]])
    errors = kind.errors(candidate, config, target, T_s_t)
    return errors.reshape(len(errors), -1)


def rms_by(keys: NDArray[np.intp], sizes: Array, count: int) -> Array:
    """(count,) rms of sizes (N,) per key (N,); NaN where there is none."""
    total = np.bincount(keys, minlength=count)
    squares = np.bincount(keys, sizes**2, minlength=count)
    result: Array = np.sqrt(np.where(total > 0, squares / np.maximum(total, 1), np.nan))
    return result
