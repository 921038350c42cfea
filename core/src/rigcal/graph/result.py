"""From the solution to what the user gets: poses, statistics, and why data were left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rigcal.calibration import (
    Calibration,
    GraphError,
    JointCovariance,
    RefinedNumber,
    Rejection,
    ResidualStatistics,
    SensorResult,
)
from rigcal.diagnosis.verdict import Verdict
from rigcal.exposures import association_of
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.global_estimate import Estimate
from rigcal.graph.information import information
from rigcal.graph.method import Method
from rigcal.graph.msgcal import graph_error_m2
from rigcal.graph.pairwise import PairResult
from rigcal.graph.selection import Selection, misfit
from rigcal.graph.solve import Solution
from rigcal.graph.stages import Stages
from rigcal.graph.task import Task

# Real sensors are seldom noisier than this times what their data sheet says.
_SUSPICIOUS_SCALE = 5.0


def make_result(
    stages: Stages, estimate: Estimate, method: Method, verdict: Verdict | None
) -> Calibration:
    """The calibration of all sensors; every observation that is no inlier is in `rejected`."""
    task, solution, selections = stages.task, estimate.solution, estimate.selections
    refined = _refined(solution)
    sigmas = _sigmas(stages, solution)
    sensors = {}
    for name in task.rig.sensors:
        own = [e for e in solution.edges if e.sensor == name]
        detected = [s[name] for s in task.exposures.values() if name in s and s[name].candidates]
        covariance = None if name in stages.fixed else solution.information.covariance_of(name)
        sensors[name] = SensorResult(
            task.rig.root,
            solution.sensors[name],
            covariance,
            len(detected),
            len(own),
            residual_statistics(task, solution, name, selections),
            solution.scales.get(name),
            refined["sensors"].get(name, {}),
            {} if name in stages.fixed else {how: sigma[name] for how, sigma in sigmas.items()},
        )
    rejected = tuple(
        Rejection(name, exposure, o.origin, reason)
        for exposure, seen in task.exposures.items()
        for name, o in seen.items()
        if (reason := estimate.why_not(o))
    )
    return Calibration(
        task.rig.root,
        sensors,
        dict(solution.targets),
        rejected,
        (
            *_noise_warnings(solution),
            *_fixed_warnings(sensors, stages),
            *_warnings(stages.pairs),
            *stages.warnings,
        ),
        {"seed": stages.seed, **vars(method), "association": _association(task)},
        graph_error=_graph_error(stages, solution, method),
        refined_targets=refined["targets"],
        joint_covariance=_joint_covariance(solution),
        verdict=verdict,
    )


def _joint_covariance(solution: Solution) -> JointCovariance:
    names, all_of_them = solution.information.sensors, solution.information.covariance
    return JointCovariance(names, all_of_them[: 6 * len(names), : 6 * len(names)])


def _sigmas(stages: Stages, solution: Solution) -> dict[str, dict[str, Array]]:
    """Standard deviations (6,) per sensor, by the noise as configured and, if it was, estimated."""
    result, noises = {}, {"configured": dict[str, float]()}
    if solution.scales:
        noises["estimated"] = dict(solution.scales)
    for how, scales in noises.items():
        edges = [replace(e, scale=scales.get(e.sensor, 1.0)) for e in solution.edges]
        info = information(
            edges, solution.sensors, solution.targets, stages.fixed, numbers=solution.numbers
        )
        result[how] = {s: np.sqrt(np.diagonal(info.covariance_of(s))) for s in info.sensors}
    return result


def _refined(solution: Solution) -> dict[str, dict[str, dict[str, RefinedNumber]]]:
    """What was refined, of sensors and of targets, by owner and name."""
    numbers = solution.numbers
    found: dict[str, dict[str, dict[str, RefinedNumber]]] = {"sensors": {}, "targets": {}}
    if not len(numbers):
        return found
    covariance = numbers.covariance(solution.information.covariance_of_numbers)
    sigma = np.sqrt(np.diagonal(covariance))
    for g in numbers.groups:
        own = found["targets" if g.is_target else "sensors"].setdefault(g.owner, {})
        for i, name in enumerate(g.parameters.names, start=g.start):
            value, spread, start = (float(v[i]) for v in (numbers.values, sigma, numbers.start))
            own[name] = RefinedNumber(value, spread, start, g.parameters.units[i - g.start])
    return found


def _association(task: Task) -> str:
    observations = [o for seen in task.exposures.values() for o in seen.values()]
    return association_of(task.rig.association, observations)


def _graph_error(stages: Stages, solution: Solution, method: Method) -> GraphError | None:
    if len(solution.numbers):
        # The graph's observations were made with the lenses and sizes from before.
        return None
    graph = stages.graph(filtered=method.filtered)
    if not graph.exposures:
        return None
    before, after = (graph_error_m2(graph, T) for T in (stages.T_root, solution.sensors))
    return GraphError(before, after, graph.edges)


def residual_statistics(
    task: Task,
    solution: Solution,
    name: str,
    selections: Mapping[str, Selection],
) -> ResidualStatistics | None:
    """Rms of the raw measurements' errors over a sensor's edges, masked ones left out.

    Of the geometry's errors if the type offers no others, or if a candidate was made by hand.
    """
    kind, target = task.kinds[name], solution.numbers.target(name, task)
    config = solution.numbers.applied(name, task)
    seen = [
        (e, task.exposures[e.exposure][name].candidates[selections[e.exposure].chosen[name]])
        for e in solution.edges
        if e.sensor == name
    ]
    raw = kind.errors is not None and not any(candidate.by_hand for _, candidate in seen)
    values = []
    for edge, candidate in seen:
        T_s_t = se3.inverse(solution.sensors[name]) @ solution.targets[edge.exposure]
        T_s_t = solution.numbers.seen(name, T_s_t)
        if kind.errors is None or not raw:
            values.append(np.array([misfit(candidate.geometry, T_s_t, target)]))
            continue
        errors = kind.errors(candidate, config, target, T_s_t)
        if edge.keep is not None and len(edge.keep) == len(errors):
            errors = errors[edge.keep]
        values.append(errors.reshape(-1))
    if not values:
        return None
    errors = np.concatenate(values)
    rms = float(np.sqrt(np.mean(errors**2)))
    return ResidualStatistics(kind.unit if raw else "m", rms, len(errors))


def _noise_warnings(solution: Solution) -> tuple[str, ...]:
    return tuple(
        f"{name}: its data disagree with the result by {scale:.3g} times the configured noise; "
        "check its entry in the rig file (intrinsics of a camera), the target's dimensions, and "
        "that the board stood still"
        for name, scale in solution.scales.items()
        if scale > _SUSPICIOUS_SCALE
    )


def _fixed_warnings(sensors: Mapping[str, SensorResult], stages: Stages) -> tuple[str, ...]:
    return tuple(
        f"{name}: at its fixed pose none of its {found.observations} observations agrees with the "
        "other sensors; check its `pose` in the rig file, or take `fixed` out"
        for name, found in sensors.items()
        if name in stages.fixed - {stages.task.rig.root}
        and found.observations
        and not found.inliers
    )


def _warnings(pairs: Sequence[PairResult]) -> tuple[str, ...]:
    return tuple(
        f"{p.a} - {p.b}: {p.shared} shared exposures: {p.reason}"
        for p in pairs
        if p.shared >= 5 and p.T_a_b is None and p.can_join
    )
