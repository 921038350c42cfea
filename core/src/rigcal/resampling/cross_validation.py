"""Exposures held out in folds: how well the others' calibration explains them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigcal.calibration import ResidualStatistics
from rigcal.errors import CalibrationError, ConfigError, ObservationError
from rigcal.estimation import prepare, solved
from rigcal.exposures import by_exposure
from rigcal.geometry.se3 import Array
from rigcal.graph import joint
from rigcal.graph.edge import SensorTargetEdge
from rigcal.graph.global_estimate import Estimate
from rigcal.graph.information import SensorInformation, information
from rigcal.graph.method import Method
from rigcal.graph.result import residual_statistics
from rigcal.graph.solve import Solution
from rigcal.graph.stack import poses_of
from rigcal.graph.stages import Stages
from rigcal.observation import Observation
from rigcal.plugin.registry import Registry
from rigcal.progress import Progress
from rigcal.rig import Rig

# A true covariance is called into question with this probability.
_SIGNIFICANCE = 1e-3


@dataclass(frozen=True)
class Fold:
    """Exposures that were held out together; `problem`: why the others give no calibration."""

    exposures: tuple[str, ...]
    problem: str = ""


@dataclass(frozen=True)
class HeldOut:
    """Rms of a sensor's errors in the same exposures, in `unit`: when they were part of the
    estimate, and when they were not.
    """

    unit: str
    count: int
    fitted_rms: float
    held_out_rms: float


@dataclass(frozen=True)
class CrossValidation:
    """Residuals of held-out exposures against fitted ones.

    `excess` is the sum of squares, whitened, of all that was held out over that of the same when
    fitted, less 1: how much worse the rig explains what it has not seen. If the covariance is true
    its mean is `expected` and its standard deviation `deviation`.
    """

    folds: tuple[Fold, ...]
    sensors: Mapping[str, HeldOut]
    excess: float
    expected: float
    deviation: float

    @property
    def limit(self) -> float:
        """The `excess` that a true covariance exceeds once in 1000 times.

        A sum of squares that few errors dominate is skewed: the limit is that of the chi-square
        law with its mean and variance (F. E. Satterthwaite, 1946).
        """
        from scipy.stats import chi2

        unit = self.deviation**2 / (2 * self.expected)
        return unit * float(chi2.isf(_SIGNIFICANCE, self.expected / unit))

    @property
    def holds(self) -> bool:
        """Whether every fold has an answer, and unseen exposures are explained as expected."""
        return not any(fold.problem for fold in self.folds) and self.excess <= self.limit


def cross_validate(
    rig: Rig,
    registry: Registry,
    observations: Sequence[Observation],
    folds: int = 5,
    seed: int = 0,
    progress: Progress | None = None,
) -> CrossValidation:
    """Calibrate without a fold of the exposures, and see how well that explains them; all folds.

    (M. Stone, Cross-validatory choice and assessment of statistical predictions, 1974.) Every fold
    is calibrated from its pairs on. Of what it held out, what the calibration of all counts as
    inliers is explained by its sensors, with boards of its own. ConfigError for fewer than two
    folds, or more than exposures; errors as of `calibrate` if all exposures together give no
    answer, CalibrationError if no fold does.
    """
    tell = progress or (lambda *_: None)
    parts = list(_parts(observations, folds, seed))
    method = Method()
    tell("cross-validation", 0, folds + 1)
    stages = prepare(rig, registry, observations, seed)
    full, _ = solved(stages, method)
    made, explained = [], []
    for number, held in enumerate(parts, start=1):
        tell("cross-validation", number, folds + 1)
        try:
            rest = prepare(rig, registry, [o for o in observations if o.exposure not in held], seed)
            found, _ = solved(rest, method)
        except (CalibrationError, ObservationError) as error:
            # Some sensors may have seen the target in this fold only.
            made.append(Fold(held, str(error)))
            continue
        made.append(Fold(held))
        explained.append(_explained(stages, full, rest, found.solution))
    tell("cross-validation", folds + 1, folds + 1)
    if not any(e.fitted.edges for e in explained):
        raise CalibrationError(
            f"none of {folds} folds gives a calibration that explains other exposures"
            + "".join(f"; {fold.problem}" for fold in made[:1])
        )
    return _summary(stages, full, made, [e for e in explained if e.fitted.edges])


def _parts(observations: Sequence[Observation], folds: int, seed: int) -> Iterator[tuple[str, ...]]:
    """The exposures in which anything was seen, dealt out in random order."""
    names = [
        name
        for name, seen in by_exposure(observations).items()
        if any(o.candidates for o in seen.values())
    ]
    if not 2 <= folds <= len(names):
        raise ConfigError(
            f"{folds} folds of {len(names)} exposures in which the target was seen; expected 2 or "
            "more, and no more than there are exposures"
        )
    order = np.random.default_rng(seed).permutation(len(names))
    for fold in range(folds):
        yield tuple(names[i] for i in sorted(order[fold::folds]))


@dataclass(frozen=True, eq=False)
class _Explained:
    """Held-out edges as the calibration of all explains them, and as that of the others does.

    `chi2` (2,) of both, the latter's expectation over the former's, and the variance of that.
    """

    fitted: Solution
    held_out: Solution
    chi2: Array
    expected: float
    variance: float


def _explained(stages: Stages, full: Estimate, rest: Stages, found: Solution) -> _Explained:
    all_of_it = full.solution
    edges = tuple(e for e in all_of_it.edges if e.exposure not in rest.task.exposures)
    names = dict.fromkeys(e.exposure for e in edges)
    boards = {name: all_of_it.targets[name] for name in names}
    fitted = replace(all_of_it, edges=edges, targets=boards)
    if not edges:
        return _Explained(fitted, fitted, np.zeros(2), 0.0, 0.0)
    everyone, held = frozenset(all_of_it.sensors), found.numbers.held()
    moved = joint.solve(edges, found.sensors, boards, everyone, held).targets
    held_out = replace(fitted, sensors=found.sensors, targets=moved, numbers=found.numbers)
    growth = _growth(edges, all_of_it, found, boards, stages.fixed)
    chi2 = np.array([_chi2(fitted), _chi2(held_out)])
    return _Explained(
        fitted, held_out, chi2, float(np.trace(growth)), 2 * float(np.sum(growth * growth.T))
    )


def _growth(
    edges: Sequence[SensorTargetEdge],
    full: Solution,
    found: Solution,
    boards: Mapping[str, Array],
    fixed: frozenset[str],
) -> Array:
    """Its trace is by how much chi2 is larger held out than fitted, on average.

    With S the information of the held-out exposures alone, fitted they lose tr(S C) of their
    expectation to an estimate of covariance C that rests on them, and gain tr(S C') with one of
    covariance C' that does not.
    """
    info = SensorInformation(edges, full.sensors, list(boards), fixed, full.numbers)
    S, _ = info.at(poses_of(boards))
    S[range(-len(full.numbers), 0), range(-len(full.numbers), 0)] -= full.numbers.known
    # Solutions have their sensors in the order of their trees.
    own, other = full.information.sensors, found.information.sensors
    order = [6 * other.index(s) + i for s in own for i in range(6)]
    order += range(6 * len(own), len(S))
    C = found.information.covariance[np.ix_(order, order)]
    growth: Array = S @ (full.information.covariance + C)
    return growth


def _chi2(solution: Solution) -> float:
    """The sum of squares of its edges where it puts the sensors and the boards."""
    fixed = frozenset(solution.sensors)
    numbers = solution.numbers.held()
    fits = information(solution.edges, solution.sensors, solution.targets, fixed, numbers=numbers)
    return sum(fit.chi2 for fit in fits.fits)


def _summary(
    stages: Stages, full: Estimate, folds: Sequence[Fold], explained: Sequence[_Explained]
) -> CrossValidation:
    sensors = {}
    for name in stages.task.rig.sensors:
        fitted = _statistics(stages, full, name, [e.fitted for e in explained])
        held_out = _statistics(stages, full, name, [e.held_out for e in explained])
        if fitted:
            count = sum(part.count for part in fitted)
            sensors[name] = HeldOut(fitted[0].unit, count, _pooled(fitted), _pooled(held_out))
    fitted_chi2, held_out_chi2 = np.sum([e.chi2 for e in explained], axis=0)
    return CrossValidation(
        tuple(folds),
        sensors,
        float(held_out_chi2 / fitted_chi2 - 1),
        float(sum(e.expected for e in explained) / fitted_chi2),
        float(np.sqrt(sum(e.variance for e in explained)) / fitted_chi2),
    )


def _statistics(
    stages: Stages, full: Estimate, sensor: str, solutions: Sequence[Solution]
) -> list[ResidualStatistics]:
    parts = [residual_statistics(stages.task, s, sensor, full.selections) for s in solutions]
    return [part for part in parts if part is not None]


def _pooled(parts: Sequence[ResidualStatistics]) -> float:
    total = sum(p.count for p in parts)
    return float(np.sqrt(sum(p.count * p.rms**2 for p in parts) / total))
