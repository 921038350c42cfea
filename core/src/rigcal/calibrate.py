"""Observations -> calibration: pairs, spanning tree, selection, global estimate, result."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigcal.calibration import Calibration, Rejection, ResidualStatistics, SensorResult
from rigcal.errors import ConfigError, NotDeterminedError, ObservationError
from rigcal.exposures import by_exposure
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.correspondence import determines
from rigcal.graph.edge import SensorTargetEdge
from rigcal.graph.pairwise import PairResult, calibrate_pair
from rigcal.graph.selection import Selection, misfit, select
from rigcal.graph.solve import Solution, estimate
from rigcal.graph.tree import spanning_tree
from rigcal.observation import Candidate, Observation
from rigcal.plugin.contract import PoseConfig, Residual, SensorType
from rigcal.plugin.registry import Registry
from rigcal.progress import Progress
from rigcal.residual import residual_of_geometry
from rigcal.rig import Rig, build_targets
from rigcal.targets.target import Target

# A pose with larger standard deviations is not determined (rad, m).
_OPEN = np.array([np.radians(3.0)] * 3 + [0.15] * 3)
_AXES = (*(f"rotation about {a}" for a in "xyz"), *(f"translation along {a}" for a in "xyz"))

Exposures = Mapping[str, Mapping[str, Observation]]


@dataclass(frozen=True, eq=False)
class _Task:
    """A rig with its observations, and everything its sensors' plugins brought."""

    rig: Rig
    kinds: Mapping[str, SensorType]
    targets: Mapping[str, Target]
    exposures: Exposures

    def target(self, sensor: str) -> Target:
        return self.targets[self.rig.target_of(sensor)]


def calibrate(
    rig: Rig,
    registry: Registry,
    observations: Sequence[Observation],
    seed: int = 0,
    progress: Progress | None = None,
) -> Calibration:
    """The tree of transforms of a rig from its observations; no initial guess is needed.

    ObservationError for observations that do not fit the rig; NotConnectedError,
    NotDeterminedError or NotConvergedError when the data do not give an answer. The same
    observations and seed give the same result.
    """
    task = _prepare(rig, registry, observations)
    tell = progress or (lambda *_: None)
    pairs = pairwise(task, seed, tell)
    given, fixed = _given_poses(rig)
    T_root, _ = spanning_tree(rig.root, list(rig.sensors), pairs, given)
    T_root |= given
    selections, refused = _select(task, T_root)
    edges = _edges(task, selections)
    boards = {k: s.T_root_t for k, s in selections.items()}
    solution = estimate(edges, T_root, boards, fixed, progress)
    _check_used(task, solution, fixed)
    _check_determined(rig, solution)
    return _result(task, solution, selections, refused, fixed, seed, pairs)


def _prepare(rig: Rig, registry: Registry, observations: Sequence[Observation]) -> _Task:
    unknown = sorted({o.sensor for o in observations} - set(rig.sensors))
    if unknown:
        raise ObservationError(
            f"observations of {', '.join(unknown)}, which the rig does not name "
            f"(it has {', '.join(rig.sensors)}); use the rig file they were made with"
        )
    for sensor in rig.sensors:
        own = [o for o in observations if o.sensor == sensor]
        if not any(o.candidates for o in own):
            reasons = sorted({o.reason for o in own})[:3]
            why = f", for example: {'; '.join(reasons)}" if reasons else ""
            raise ObservationError(
                f"sensor '{sensor}' did not see the target in any of its {len(own)} frames{why}. "
                "Check the target's type and dimensions in the rig file, and this sensor's entry"
            )
    kinds = {name: registry.sensor_type(c.type) for name, c in rig.sensors.items()}
    return _Task(rig, kinds, build_targets(rig, registry), _by_target(rig, observations))


def _by_target(rig: Rig, observations: Sequence[Observation]) -> Exposures:
    """Exposures by name; boards that stand in one exposure together are exposures of their own."""
    exposures = by_exposure(observations)
    if len(rig.targets) == 1:
        return exposures
    split: dict[str, dict[str, Observation]] = {}
    for name, seen in exposures.items():
        for sensor, o in seen.items():
            own = f"{name}/{rig.target_of(sensor)}"
            split.setdefault(own, {})[sensor] = replace(o, exposure=own)
    return split


def pairwise(task: _Task, seed: int, tell: Progress) -> list[PairResult]:
    """Every pair of sensors that look at one target; the order in a pair is one that determines."""
    names = list(itertools.combinations(task.rig.sensors, 2))
    results = []
    for done, (a, b) in enumerate(names):
        tell("pairs of sensors", done, len(names))
        if task.rig.target_of(a) != task.rig.target_of(b):
            continue
        # A stream of its own for every pair: the result does not depend on the other pairs.
        digest = hashlib.sha256(f"{seed}/{a}/{b}".encode()).digest()
        rng = np.random.default_rng(np.frombuffer(digest, dtype=np.uint32))
        shared = [
            (seen[a], seen[b])
            for seen in task.exposures.values()
            if a in seen and b in seen and seen[a].candidates and seen[b].candidates
        ]
        if shared and not _determines(shared[0]) and _determines(shared[0][::-1]):
            a, b, shared = b, a, [(y, x) for x, y in shared]
        results.append(calibrate_pair(shared, task.target(a), rng, (a, b)))
    tell("pairs of sensors", len(names), len(names))
    return results


def _determines(pair: tuple[Observation, Observation]) -> bool:
    return determines(pair[0].candidates[0].geometry, pair[1].candidates[0].geometry)


def _given_poses(rig: Rig) -> tuple[dict[str, Array], frozenset[str]]:
    """Poses `T_root_s` that the rig prescribes, and which sensors keep theirs (with the root)."""
    given, fixed = {rig.root: np.eye(4)}, {rig.root}
    pending = {n for n, c in rig.sensors.items() if (c.fixed or c.initial) and n != rig.root}
    while pending:
        ready = {n for n in pending if _pose(rig, n).parent in given}
        if not ready:
            raise ConfigError(
                f"sensors.{min(pending)}: `fixed` and `initial` need a parent whose pose is known: "
                f"the root '{rig.root}', or a sensor with `fixed` or `initial` of its own"
            )
        for n in sorted(ready):
            pose = _pose(rig, n)
            given[n] = given[pose.parent] @ pose.T_parent_sensor
            if rig.sensors[n].fixed and pose.parent in fixed:
                fixed.add(n)
            elif rig.sensors[n].fixed:
                raise ConfigError(
                    f"sensors.{n}: fixed to '{pose.parent}', which is estimated itself; "
                    "fix the parent too, or hang this sensor from the root"
                )
        pending -= ready
    return given, frozenset(fixed)


def _pose(rig: Rig, name: str) -> PoseConfig:
    pose = rig.sensors[name].pose
    assert pose is not None  # the config was validated
    return pose


def _select(
    task: _Task, T_root: Mapping[str, Array]
) -> tuple[dict[str, Selection], dict[str, str]]:
    selections, refused = {}, {}
    for exposure, seen in task.exposures.items():
        answer = select(seen, T_root, task.target(next(iter(seen))))
        if isinstance(answer, str):
            refused[exposure] = answer
        else:
            selections[exposure] = answer
    return selections, refused


def _edges(task: _Task, selections: Mapping[str, Selection]) -> list[SensorTargetEdge]:
    return [
        SensorTargetEdge(sensor, exposure, _residual(task, sensor, candidate))
        for exposure, selection in selections.items()
        for sensor, i in selection.chosen.items()
        for candidate in [task.exposures[exposure][sensor].candidates[i]]
    ]


def _residual(task: _Task, sensor: str, candidate: Candidate) -> Residual:
    make = task.kinds[sensor].residual
    if make is None:
        return residual_of_geometry(candidate)
    return make(candidate, task.rig.sensors[sensor], task.target(sensor))


def _check_used(task: _Task, solution: Solution, fixed: frozenset[str]) -> None:
    for sensor in task.rig.sensors:
        if sensor in fixed or any(e.sensor == sensor for e in solution.edges):
            continue
        reasons = [r for (s, _), r in solution.dropped.items() if s == sensor]
        raise NotDeterminedError(
            f"sensor '{sensor}': none of its observations agrees with the other sensors "
            f"({reasons[0] if reasons else 'none was chosen'}); check its entry in the rig file"
        )


def _check_determined(rig: Rig, solution: Solution) -> None:
    """Withholds a result in which a sensor's pose is open in some direction."""
    problems = []
    for sensor in solution.information.sensors:
        sigma = np.sqrt(np.diagonal(solution.information.covariance_of(sensor)))
        for i in np.flatnonzero(sigma > _OPEN):
            size = f"{np.degrees(sigma[i]):.3g} deg" if i < 3 else f"{sigma[i]:.3g} m"
            problems.append(f"  {sensor}: {_AXES[i]} of its own frame (standard deviation {size})")
    if problems:
        raise NotDeterminedError(
            "the data leave poses open:\n" + "\n".join(problems) + "\n"
            "record boards with more different tilts and places in view of these sensors together "
            "with a camera or a 3D laser; parallel boards fix only part of a pose"
        )


def _result(
    task: _Task,
    solution: Solution,
    selections: Mapping[str, Selection],
    refused: Mapping[str, str],
    fixed: frozenset[str],
    seed: int,
    pairs: Sequence[PairResult],
) -> Calibration:
    sensors = {}
    for name in task.rig.sensors:
        own = [e for e in solution.edges if e.sensor == name]
        detected = [s[name] for s in task.exposures.values() if name in s and s[name].candidates]
        covariance = None if name in fixed else solution.information.covariance_of(name)
        sensors[name] = SensorResult(
            task.rig.root,
            solution.sensors[name],
            covariance,
            len(detected),
            len(own),
            _statistics(task, solution, name, own, selections),
            solution.scales.get(name),
        )
    rejected = tuple(
        Rejection(name, exposure, o.origin, reason)
        for exposure, seen in task.exposures.items()
        for name, o in seen.items()
        if (reason := _why_not(o, solution, selections, refused))
    )
    return Calibration(
        task.rig.root,
        sensors,
        dict(solution.targets),
        rejected,
        _warnings(pairs),
        {"seed": seed, "formulation": "joint"},
    )


def _why_not(
    o: Observation,
    solution: Solution,
    selections: Mapping[str, Selection],
    refused: Mapping[str, str],
) -> str:
    """Why this observation is not among the inliers; empty if it is."""
    if not o.candidates:
        return o.reason
    if o.exposure in refused:
        return refused[o.exposure]
    if reason := selections[o.exposure].left_out.get(o.sensor):
        return reason
    return solution.dropped.get((o.sensor, o.exposure), "")


def _statistics(
    task: _Task,
    solution: Solution,
    name: str,
    own: Sequence[SensorTargetEdge],
    selections: Mapping[str, Selection],
) -> ResidualStatistics | None:
    """Rms of the raw measurements' errors over the inliers, masked ones left out."""
    kind = task.kinds[name]
    values = []
    for edge in own:
        o = task.exposures[edge.exposure][name]
        candidate = o.candidates[selections[edge.exposure].chosen[name]]
        T_s_t = se3.inverse(solution.sensors[name]) @ solution.targets[edge.exposure]
        if kind.errors is None:
            values.append(np.array([misfit(candidate.geometry, T_s_t, task.target(name))]))
            continue
        errors = kind.errors(candidate, task.rig.sensors[name], task.target(name), T_s_t)
        if edge.keep is not None and len(edge.keep) == len(errors):
            errors = errors[edge.keep]
        values.append(errors.reshape(-1))
    if not values:
        return None
    errors = np.concatenate(values)
    rms = float(np.sqrt(np.mean(errors**2)))
    return ResidualStatistics(kind.unit, rms, len(errors))


def _warnings(pairs: Sequence[PairResult]) -> tuple[str, ...]:
    return tuple(
        f"{p.a} - {p.b}: {p.shared} shared exposures, but {p.reason}"
        for p in pairs
        if p.shared >= 5 and p.T_a_b is None and "do not determine a transform" not in p.reason
    )
