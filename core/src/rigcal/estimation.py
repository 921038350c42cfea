"""Observations -> calibration: pairs, spanning tree, selection, global estimate, result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from rigcal.belonging import check_observations
from rigcal.calibration import Calibration, SensorResult
from rigcal.diagnosis.observability import judge
from rigcal.diagnosis.verdict import Verdict
from rigcal.errors import NotDeterminedError, ObservationError
from rigcal.exposures import by_exposure, name_in_result
from rigcal.geometry.se3 import Array
from rigcal.graph.edge import SensorTargetEdge
from rigcal.graph.global_estimate import Estimate, solve, start
from rigcal.graph.method import Method
from rigcal.graph.numbers import NO_NUMBERS, Numbers
from rigcal.graph.result import make_result
from rigcal.graph.stages import Stages, first_stages
from rigcal.graph.task import Exposures, Task
from rigcal.observation import Observation
from rigcal.plugin.registry import Registry
from rigcal.progress import Progress
from rigcal.rig import Rig, build_targets


def calibrate(
    rig: Rig,
    registry: Registry,
    observations: Sequence[Observation],
    seed: int = 0,
    progress: Progress | None = None,
    method: Method | None = None,
) -> Calibration:
    """The tree of transforms of a rig from its observations; no initial guess is needed.

    ObservationError for observations that do not fit the rig; NotConnectedError,
    NotDeterminedError or NotConvergedError when the data do not give an answer. The same
    observations, seed and method give the same result.
    """
    stages = prepare(rig, registry, observations, seed, progress)
    return finish(stages, method or Method(), progress)


def prepare(
    rig: Rig,
    registry: Registry,
    observations: Sequence[Observation],
    seed: int = 0,
    progress: Progress | None = None,
) -> Stages:
    """What all methods start from: pairs and spanning tree. Errors as of `calibrate`."""
    return first_stages(_task(rig, registry, tuple(observations)), seed, progress)


def finish(stages: Stages, method: Method, progress: Progress | None = None) -> Calibration:
    """The calibration by one method. Errors as of `calibrate`."""
    result, verdict = solved(stages, method, progress)
    return make_result(stages, result, method, verdict)


def solved(
    stages: Stages, method: Method, progress: Progress | None = None
) -> tuple[Estimate, Verdict | None]:
    """The global estimate by one method, and the verdict on it. Errors as of `calibrate`."""
    if stages.is_loose:
        first = start(stages)
        before = _judge(stages, first.edges, first.sensors, first.targets, provisional=True)
        _withhold(before, method)
    result = solve(stages, method, progress)
    found = result.solution
    _check_used(stages.task, result, stages.fixed)
    verdict = None
    if method.filtered:
        # Outliers blow up the covariance: without the filter it does not tell what the data fix.
        verdict = _judge(stages, found.edges, found.sensors, found.targets, found.numbers)
        _withhold(verdict, method)
    return result, verdict


def pairwise_calibration(stages: Stages) -> Calibration:
    """The spanning tree of the pairs as it is, without a global estimate."""
    root = stages.task.rig.root
    sensors = {s: SensorResult(root, stages.T_root[s]) for s in stages.task.rig.sensors}
    return Calibration(root, sensors, provenance={"seed": stages.seed, "formulation": "pairwise"})


def _task(rig: Rig, registry: Registry, observations: Sequence[Observation]) -> Task:
    check_observations(rig, observations)
    for sensor in rig.sensors:
        own = [o for o in observations if o.sensor == sensor]
        if not own:
            raise ObservationError(
                f"there is no observation of sensor '{sensor}'; record it with the others, or take "
                "it out of the rig"
            )
        if not any(o.candidates for o in own):
            reasons = sorted({o.reason for o in own})[:3]
            why = f", for example: {'; '.join(reasons)}" if reasons else ""
            raise ObservationError(
                f"sensor '{sensor}' did not see the target in any of its {len(own)} frames{why}. "
                "Check the target's type and dimensions in the rig file, and this sensor's entry"
            )
    kinds = {name: registry.sensor_type(c.type) for name, c in rig.sensors.items()}
    return Task(rig, kinds, build_targets(rig, registry), _by_target(rig, observations))


def _by_target(rig: Rig, observations: Sequence[Observation]) -> Exposures:
    """Exposures by name; boards that stand in one exposure together are exposures of their own."""
    split: dict[str, dict[str, Observation]] = {}
    for seen in by_exposure(observations).values():
        for sensor, o in seen.items():
            name = name_in_result(rig, o)
            split.setdefault(name, {})[sensor] = replace(o, exposure=name)
    return split


def _check_used(task: Task, estimate: Estimate, fixed: frozenset[str]) -> None:
    used = fixed | {e.sensor for e in estimate.solution.edges}
    for sensor in (s for s in task.rig.sensors if s not in used):
        own = (seen[sensor] for seen in task.exposures.values() if sensor in seen)
        reason = next(estimate.why_not(o) for o in own if o.candidates)
        raise NotDeterminedError(
            f"sensor '{sensor}': none of its observations agrees with the other sensors, for "
            f"example: {reason}; check its entry in the rig file"
        )


def _judge(
    stages: Stages,
    edges: Sequence[SensorTargetEdge],
    sensors: Mapping[str, Array],
    targets: Mapping[str, Array],
    numbers: Numbers = NO_NUMBERS,
    *,
    provisional: bool = False,
) -> Verdict:
    task = stages.task
    flat = frozenset(name for name, kind in task.kinds.items() if kind.flat)
    root, fixed = task.rig.root, stages.fixed
    return judge(edges, sensors, targets, fixed, root, flat, numbers, provisional=provisional)


def _withhold(verdict: Verdict, method: Method) -> None:
    """NotDeterminedError for a pose that is open, unless the method accepts it."""
    if verdict.withheld and not method.accept_weak:
        raise NotDeterminedError("\n".join(verdict.lines()), verdict)
