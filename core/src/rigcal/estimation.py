"""Observations -> calibration: pairs, spanning tree, selection, global estimate, result."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rigcal.calibration import Calibration
from rigcal.errors import ConfigError, NotDeterminedError, ObservationError
from rigcal.exposures import by_exposure
from rigcal.geometry.se3 import Array
from rigcal.graph.correspondence import determines
from rigcal.graph.edge import SensorTargetEdge
from rigcal.graph.pairwise import PairResult, calibrate_pair
from rigcal.graph.result import make_result
from rigcal.graph.selection import Selection, select
from rigcal.graph.solve import Solution, estimate
from rigcal.graph.task import Exposures, Task
from rigcal.graph.tree import spanning_tree
from rigcal.observation import Observation
from rigcal.plugin.contract import PoseConfig
from rigcal.plugin.registry import Registry
from rigcal.progress import Progress
from rigcal.rig import Rig, build_targets

# A pose with larger standard deviations is not determined (rad, m).
_OPEN = np.array([np.radians(3.0)] * 3 + [0.15] * 3)
_AXES = (*(f"rotation about {a}" for a in "xyz"), *(f"translation along {a}" for a in "xyz"))


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
    own_noise = rig.noise == "estimated"
    solution = estimate(edges, T_root, boards, fixed, progress, estimate_noise=own_noise)
    _check_used(task, solution, fixed)
    _check_determined(rig, solution)
    return make_result(task, solution, selections, refused, fixed, seed, pairs)


def _prepare(rig: Rig, registry: Registry, observations: Sequence[Observation]) -> Task:
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
    return Task(rig, kinds, build_targets(rig, registry), _by_target(rig, observations))


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


def pairwise(task: Task, seed: int, tell: Progress) -> list[PairResult]:
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


def _select(task: Task, T_root: Mapping[str, Array]) -> tuple[dict[str, Selection], dict[str, str]]:
    selections, refused = {}, {}
    for exposure, seen in task.exposures.items():
        answer = select(seen, T_root, task.target(next(iter(seen))))
        if isinstance(answer, str):
            refused[exposure] = answer
        else:
            selections[exposure] = answer
    return selections, refused


def _edges(task: Task, selections: Mapping[str, Selection]) -> list[SensorTargetEdge]:
    return [
        SensorTargetEdge(sensor, exposure, task.residual(sensor, candidate))
        for exposure, selection in selections.items()
        for sensor, i in selection.chosen.items()
        for candidate in [task.exposures[exposure][sensor].candidates[i]]
    ]


def _check_used(task: Task, solution: Solution, fixed: frozenset[str]) -> None:
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
