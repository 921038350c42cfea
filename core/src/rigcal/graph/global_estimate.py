"""The global estimate of a method, from stages that are the same for all of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from rigcal.errors import ConfigError, NotConvergedError, NotDeterminedError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph import joint, msgcal
from rigcal.graph.choice import best_ranked
from rigcal.graph.edge import SensorTargetEdge
from rigcal.graph.method import Method
from rigcal.graph.numbers import numbers_of
from rigcal.graph.selection import POSE_IS_OPEN, Selection, first_board, select
from rigcal.graph.solve import TURN_IS_OPEN, Solution, estimate
from rigcal.graph.stages import Stages
from rigcal.graph.task import Task
from rigcal.observation import Candidate, Observation
from rigcal.progress import Progress

# Two runs to one minimum end this close to each other, in standard deviations.
_SAME_MINIMUM = 1.0
_NO_EDGE = "no pair of sensors counts it among its inliers"


@dataclass(frozen=True, eq=False)
class Estimate:
    """A global estimate, and which observations it was offered or why not, by exposure."""

    solution: Solution
    selections: Mapping[str, Selection]
    refused: Mapping[str, str]

    def why_not(self, o: Observation) -> str:
        """Why this observation is not among the inliers; empty if it is."""
        if not o.candidates:
            return o.reason
        if o.exposure in self.refused:
            return self.refused[o.exposure]
        if reason := self.selections[o.exposure].left_out.get(o.sensor):
            return reason
        return self.solution.dropped.get((o.sensor, o.exposure), "")


@dataclass(frozen=True, eq=False)
class Start:
    """Where the joint estimate starts: its edges, and first poses of the sensors and the boards."""

    edges: tuple[SensorTargetEdge, ...]
    sensors: Mapping[str, Array]
    targets: Mapping[str, Array]


def start(stages: Stages) -> Start:
    """The start from the spanning tree, on what the sensors agree on there."""
    selections, _ = _select(stages, filtered=True)
    boards = {k: s.T_root_t for k, s in selections.items()}
    return Start(tuple(_edges(stages.task, selections)), stages.T_root, boards)


def solve(stages: Stages, method: Method, progress: Progress | None = None) -> Estimate:
    """The global estimate by a method.

    NotConvergedError if there is none, or if one that did not start from the spanning tree ends
    anywhere else than the one that does: at a minimum that is not the lowest. NotDeterminedError
    where the graph of MSG-Cal leaves a pose open, or has no edges to spare.
    """
    formulation = {"joint": _solve_joint, "msgcal": _solve_msgcal}[method.formulation]
    result = formulation(stages, method, progress)
    if method.initial != "tree":
        reference = formulation(stages, replace(method, initial="tree"), progress)
        _check_same_minimum(result.solution, reference.solution)
    return result


def _solve_joint(stages: Stages, method: Method, progress: Progress | None) -> Estimate:
    task = stages.task
    selections, refused = _select(stages, filtered=method.filtered)
    if method.initial != "tree":
        # Edges in metres lead from far off to where those in pixels and ranges are nearly linear.
        graph = stages.graph(filtered=method.filtered)
        found = msgcal.solve(graph, stages.start(method), stages.fixed).sensors
        stages = replace(stages, T_root=found)
        selections, refused = _select(stages, filtered=method.filtered)
    solution = estimate(
        _edges(task, selections), stages.T_root,
        {k: s.T_root_t for k, s in selections.items()}, stages.fixed, progress,
        estimate_noise=task.rig.noise == "estimated", reject=method.filtered,
        anchored=method.accept_weak, numbers=numbers_of(task),
    )  # fmt: skip
    return Estimate(solution, selections, refused)


def _solve_msgcal(stages: Stages, method: Method, progress: Progress | None) -> Estimate:
    """The graph's sensors; the boards are those that fit the measurements best with them."""
    task, tell = stages.task, progress or (lambda *_: None)
    if len(numbers_of(task)):
        raise ConfigError(
            "the formulation msgcal estimates poses only: take `refine` out of the rig file, or "
            "use the formulation joint"
        )
    tell("global estimate", 0, 1)
    graph = stages.graph(filtered=method.filtered)
    if graph.redundancy(len(stages.T_root) - len(stages.fixed)) <= 0:
        raise NotDeterminedError(
            f"the graph of MSG-Cal has {graph.edges} edges of observations, no more than its poses "
            "need: nothing tells how exact they are; record more exposures, or use the formulation "
            "joint (observations of a point and of a plane, or of two lines, have no edge)"
        )
    solved = msgcal.solve(graph, stages.start(method), stages.fixed)
    selections, refused = {}, dict.fromkeys(task.exposures, _NO_EDGE)
    for x in graph.exposures:
        seen, chosen = task.exposures[x.exposure], {n.sensor: n.candidate for n in x.nodes}
        T_root_t = first_board(seen, chosen, solved.sensors)
        if T_root_t is None:
            refused[x.exposure] = POSE_IS_OPEN
            continue
        left_out = {s: _NO_EDGE for s, o in seen.items() if o.candidates and s not in chosen}
        selections[x.exposure] = Selection(T_root_t, chosen, left_out, has_pose=True)
        del refused[x.exposure]
    edges = _edges(task, selections)
    boards = {exposure: s.T_root_t for exposure, s in selections.items()}
    # Robustly: pairs of sensors may agree on two places in one exposure.
    held = frozenset(solved.sensors)
    boards = joint.solve_robust(edges, solved.sensors, boards, held).targets
    tell("global estimate", 1, 1)
    solution = Solution(solved.sensors, boards, tuple(edges), solved.information, {}, {})
    return Estimate(solution, selections, refused)


def _check_same_minimum(solution: Solution, reference: Solution) -> None:
    """NotConvergedError if the sensors' poses are not those of the reference."""
    off = []
    for s in reference.information.sensors:
        D = se3.inverse(reference.sensors[s]) @ solution.sensors[s]
        xi, covariance = se3.log(D), reference.information.covariance_of(s)
        if not xi @ np.linalg.solve(covariance, xi) < _SAME_MINIMUM**2:
            degrees, mm = np.degrees(np.linalg.norm(xi[:3])), 1e3 * np.linalg.norm(D[:3, 3])
            off.append(f"{s} by {degrees:.3g} deg and {mm:.3g} mm")
    if off:
        raise NotConvergedError(
            "started from the identity, the global estimate ends at another minimum than from the "
            f"spanning tree: it is off for {', '.join(off)}; start it from the tree"
        )


def _select(stages: Stages, *, filtered: bool) -> tuple[dict[str, Selection], dict[str, str]]:
    """What the sensors in the tree's poses agree on, or everything, by exposure."""
    task, selections, refused = stages.task, dict[str, Selection](), dict[str, str]()
    everything = {} if filtered else best_ranked(task)
    for exposure, seen in task.exposures.items():
        target = task.target(next(iter(seen)))
        answer = select(seen, stages.T_root, target)
        if exposure in everything:
            answer = _all_of(seen, everything[exposure], stages.T_root, answer)
        if isinstance(answer, str):
            refused[exposure] = answer
        elif target.may_bend and not _tells_turn(task, exposure, answer):
            refused[exposure] = TURN_IS_OPEN
        else:
            selections[exposure] = answer
    return selections, refused


def _tells_turn(task: Task, exposure: str, selection: Selection) -> bool:
    return any(c.tells_turn for c in _chosen(task, exposure, selection).values())


def _chosen(task: Task, exposure: str, selection: Selection) -> dict[str, Candidate]:
    """The chosen candidate of every sensor."""
    seen = task.exposures[exposure]
    return {sensor: seen[sensor].candidates[i] for sensor, i in selection.chosen.items()}


def _all_of(
    seen: Mapping[str, Observation],
    chosen: Mapping[str, int],
    T_root: Mapping[str, Array],
    agreed: Selection | str,
) -> Selection | str:
    """All observations of an exposure, with the board's place as far as sensors agree on one."""
    if isinstance(agreed, Selection):
        return Selection(agreed.T_root_t, chosen, {}, agreed.has_pose)
    T_root_t = first_board(seen, chosen, T_root)
    return agreed if T_root_t is None else Selection(T_root_t, chosen, {}, has_pose=True)


def _edges(task: Task, selections: Mapping[str, Selection]) -> list[SensorTargetEdge]:
    return [
        SensorTargetEdge(sensor, exposure, task.residual(sensor, c), in_plane=c.tells_turn)
        for exposure, selection in selections.items()
        for sensor, c in _chosen(task, exposure, selection).items()
    ]
