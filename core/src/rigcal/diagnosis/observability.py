"""Which axes of the sensors' poses the data determine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rigcal.diagnosis.causes import explain
from rigcal.diagnosis.verdict import Axis, SensorVerdict, Verdict
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.edge import SensorTargetEdge
from rigcal.graph.known import known_information
from rigcal.graph.numbers import NO_NUMBERS, Numbers

# With larger standard deviations an axis is open, or weak (rad, m).
OPEN = np.array([np.radians(3.0)] * 3 + [0.15] * 3)
WEAK = np.array([np.radians(0.5)] * 3 + [0.02] * 3)
# In units of what is open: the most that a direction without information has.
_UNKNOWN = 1e3
# An open direction counts as so many times what is open: it makes an axis open of which it has a
# third, and leaves one alone of which it has a trace.
_WIDEST = 3.0


def judge(
    edges: Sequence[SensorTargetEdge],
    sensors: Mapping[str, Array],
    targets: Mapping[str, Array],
    fixed: frozenset[str],
    root: str,
    flat: frozenset[str],
    numbers: Numbers = NO_NUMBERS,
    *,
    provisional: bool = False,
) -> Verdict:
    """The verdict on sensor poses `T_root_s` and target poses `T_root_t` as the edges fix them.

    `flat` names the sensors that look along a plane only. Poses are judged as seen from the root.
    If that leaves more sensors open than seen from another one, it is the root that hangs loosely,
    and the other is the reference. At `provisional` poses, which may be off in what is open, a weak
    axis cannot be told from an open one, and counts as that.
    """
    names = [s for s in sensors if s not in fixed]
    information = known_information(edges, sensors, targets, fixed, numbers)
    joint = _covariance(information, len(names), len(numbers))
    limit = WEAK if provisional else OPEN
    found = {r: _axes_from(r, sensors, names, joint, limit) for r in (root, *names)}
    opened = {
        r: sum(any(a.state == "open" for a in own) for own in found[r].values()) for r in found
    }
    reference = min(found, key=lambda r: (opened[r], r != root))
    verdicts = {}
    for sensor, axes in found[reference].items():
        falls_short = any(axis.state != "determined" for axis in axes)
        why = explain(sensor, edges, sensors, targets, sensor in flat) if falls_short else ((), ())
        verdicts[sensor] = SensorVerdict(axes, *why)
    return Verdict(reference, verdicts)


def leaves_open(information: Array, sensors: int, numbers: int) -> bool:
    """Whether information (6 S + Q, 6 S + Q) of free sensors and numbers leaves an axis open."""
    return bool(np.any(np.diagonal(_covariance(information, sensors, numbers)) > 1.0))


def _covariance(information: Array, sensors: int, numbers: int) -> Array:
    """(6 S, 6 S) of the sensors in units of what is open, with bounds for what is unknown."""
    unit = np.concatenate([np.tile(OPEN, sensors), np.ones(numbers)])
    scaled = information * np.outer(unit, unit)
    values, vectors = np.linalg.eigh((scaled + scaled.T) / 2)
    root = vectors / np.sqrt(np.maximum(values, _UNKNOWN**-2))
    result: Array = (root @ root.T)[: 6 * sensors, : 6 * sensors]
    return result


def _axes_from(
    reference: str,
    sensors: Mapping[str, Array],
    names: Sequence[str],
    joint: Array,
    limit: Array,
) -> dict[str, tuple[Axis, ...]]:
    """The axes of every other sensor in the reference's frame; `joint` is that of `names`.

    An axis is open beyond `limit` (6,).
    """
    result = {}
    for sensor in sensors:
        if sensor == reference or (sensor not in names and reference not in names):
            continue
        # T_r_s = T_r^-1 T_s moves by the sensor's perturbation less the adjoint of the reference's.
        rows = np.zeros((6, len(joint)))
        if sensor in names:
            at = 6 * names.index(sensor)
            rows[:, at : at + 6] += np.eye(6)
        if reference in names:
            at = 6 * names.index(reference)
            A = se3.adjoint(se3.inverse(sensors[sensor]) @ sensors[reference])
            rows[:, at : at + 6] -= A * OPEN / OPEN[:, None]
        result[sensor] = _axes(rows @ joint @ rows.T, limit)
    return result


def _axes(covariance: Array, limit: Array) -> tuple[Axis, ...]:
    """Covariance (6, 6) in units of what is open -> the six axes."""
    values, vectors = np.linalg.eigh(covariance * np.outer(OPEN / limit, OPEN / limit))
    narrowed = (vectors * np.clip(values, 0.0, _WIDEST**2)) @ vectors.T
    sigma = np.sqrt(np.diagonal(narrowed)) * limit
    return tuple(
        Axis("open", float("inf")) if s >= most else Axis("weak" if s > weak else "determined", s)
        for s, most, weak in zip(sigma.tolist(), limit.tolist(), WEAK.tolist(), strict=True)
    )
