"""How well the sensors can be known at all, and how near an estimator comes to that."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rigcal.geometry.se3 import Array
from rigcal.graph.choice import best_ranked
from rigcal.graph.edge import SensorTargetEdge
from rigcal.graph.information import information
from rigcal.graph.task import Task


def cramer_rao_bound(
    task: Task, T_root_s: Mapping[str, Array], T_root_t: Mapping[str, Array]
) -> dict[str, Array]:
    """The least covariance (6, 6) that an unbiased estimate of each sensor's pose can have.

    It is the inverse information of all residuals at the true poses of sensors and targets, those
    of the targets eliminated (H. Cramer, Mathematical Methods of Statistics, 1946, ch. 32), with
    the configured noise; over [rotation, translation], right perturbation. The root has none.
    What a detector makes of the measurements is not in question: the first candidate of every
    observation counts as true.
    """
    edges = [
        SensorTargetEdge(s, exposure, task.residual(s, task.exposures[exposure][s].candidates[i]))
        for exposure, chosen in best_ranked(task).items()
        for s, i in chosen.items()
    ]
    targets = {
        exposure: T_root_t[exposure] for exposure in dict.fromkeys(e.exposure for e in edges)
    }
    at_truth = information(edges, T_root_s, targets, frozenset({task.rig.root}))
    return {s: at_truth.covariance_of(s) for s in at_truth.sensors}


@dataclass(frozen=True)
class Ratio:
    """A ratio to the bound: 1 for an efficient estimator, with its standard deviation by chance."""

    value: float
    deviation: float


@dataclass(frozen=True)
class Efficiency:
    """Rms error over the bound of one sensor, over runs.

    rotation, translation  rms of the vector's length over the root of the bound's trace
    pose                   sqrt(mean of e^T C^-1 e / 6), C the bound: all directions weigh alike
    """

    rotation: Ratio
    translation: Ratio
    pose: Ratio


def efficiency(errors: Array, bounds: Array) -> Efficiency:
    """Efficiency from the errors (N, 6) of N runs and the bound of each, (N, 6, 6).

    An error is `log(T_true^-1 T_estimated)`, [rotation, translation]. The deviations are those of
    an efficient estimator: 1 / sqrt(2 * 6 N) for the pose, larger where few directions dominate.
    """
    nees = np.einsum("ni,ni->n", errors, np.linalg.solve(bounds, errors[..., None])[..., 0])
    pose = Ratio(float(np.sqrt(nees.mean() / 6)), float(1 / np.sqrt(12 * len(errors))))
    return Efficiency(_ratio(errors, bounds, slice(3)), _ratio(errors, bounds, slice(3, 6)), pose)


def _ratio(errors: Array, bounds: Array, part: slice) -> Ratio:
    C = bounds[:, part, part]
    total = float(np.trace(C, axis1=1, axis2=2).sum())
    # The square of a normal vector with covariance C has variance 2 tr(C C).
    spread = float(np.sqrt(2 * np.sum(C * C)))
    value = float(np.sqrt(np.sum(errors[:, part] ** 2) / total))
    return Ratio(value, spread / total / 2)
