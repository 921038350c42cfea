"""The graph of MSG-Cal: sensors, one node per observation, and three kinds of edges.

J. L. Owens, P. R. Osteen, K. Daniilidis, "MSG-Cal: Multi-sensor Graph-based Calibration", IROS
2015. docs/adr says what its description leaves open, and how that was filled in.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rigcal.errors import NotConvergedError, NotDeterminedError
from rigcal.geometry.se3 import Array
from rigcal.graph.exposure_graph import EdgeRows, ExposureGraph
from rigcal.graph.information import Information
from rigcal.graph.pairwise import PairResult

# Holds what no edge holds (a line's turn about itself) and nothing else.
_LOOSE_SIGMA = 1e3
_FIXED_SIGMA = 1e-7
_MOST_ITERATIONS = 100
# Exact data must not make the edges infinitely stiff.
_LEAST_SIGMA_M = 1e-4


@dataclass(frozen=True, eq=False)
class MsgcalGraph:
    """All exposures, and the pairs whose transforms are sensor-sensor edges."""

    exposures: tuple[ExposureGraph, ...]
    pairs: tuple[PairResult, ...] = ()

    @property
    def edges(self) -> int:
        """How many edges count in the graph error."""
        return sum(len(x.nodes) + len(x.relations) for x in self.exposures)

    def redundancy(self, free: int) -> int:
        """How much the edges in metres can contradict each other, with `free` sensors to place."""
        return sum(r.rank for x in self.exposures for r in x.relations) - 6 * free

    @property
    def sigma_m(self) -> float:
        """The weight of edges in metres: rms distance over the inliers of pairs, loose ones aside.

        So they weigh against the sensor-sensor edges as the same data did in the pairs.
        """
        sure = [p for p in self.pairs if not p.is_loose]
        squares = [(len(p.inliers), len(p.inliers) * p.rms_m**2) for p in sure]
        count, total = (sum(column) for column in zip((0, 0.0), *squares, strict=True))
        return max(math.sqrt(total / max(count, 1)), _LEAST_SIGMA_M)


@dataclass(frozen=True, eq=False)
class MsgcalSolution:
    """`T_root_s` per sensor, and what is known of them."""

    sensors: dict[str, Array]
    information: Information


def solve(
    graph: MsgcalGraph, sensors: Mapping[str, Array], fixed: frozenset[str]
) -> MsgcalSolution:
    """The sensors and observation nodes that minimise all edges, from first poses `T_root_s`.

    Observations start where they were seen. Sensors named in `fixed` stay. NotConvergedError if
    the optimiser finds no minimum, NotDeterminedError if it leaves a pose open.

    The covariance is that of the graph, with the variance of the edges in metres as their
    residuals tell it. It is not that of a maximum-likelihood estimate: the pairs count the
    observations a second time, and all points alike.
    """
    free = tuple(s for s in sensors if s not in fixed)
    if not free:
        # GTSAM may search without end where only stiff priors and a pair contradict each other.
        return MsgcalSolution(dict(sensors), Information((), np.zeros((0, 0)), ()))
    problem = _Problem.of(graph, sensors, fixed)
    # From far off the sensors come near by their own edges, before observations have a say.
    near = _Problem.of(graph, _by_pairs(graph.pairs, sensors, fixed), fixed)
    if near.graph.error(near.start) < problem.graph.error(problem.start):
        problem = near
    values = problem.optimise()
    while True:
        # From a far start some nodes end upside down: they start again at the sensors as found.
        again = _Problem.of(graph, problem.sensors(values), fixed)
        if again.graph.error(again.start) >= problem.graph.error(values):
            break
        problem, values = again, again.optimise()
    error = problem.error_m2(values)
    variance = error / max(graph.redundancy(len(free)), 1) / graph.sigma_m**2
    covariance = variance * problem.covariance(values, free)
    information = Information(free, covariance, ())
    return MsgcalSolution(
        problem.sensors(values) | {s: sensors[s] for s in fixed},
        information,
    )


def _by_pairs(
    pairs: Sequence[PairResult], sensors: Mapping[str, Array], fixed: frozenset[str]
) -> dict[str, Array]:
    """`T_root_s` by the sensor-sensor edges alone: rotations by chordal relaxation, then places.

    (L. Carlone et al., "Initialization techniques for 3D SLAM", ICRA 2015; all pairs alike.) From a
    start that is turned by more than a right angle, the edges lead to false minima.
    """
    import gtsam

    keys = {s: gtsam.symbol("s", i) for i, s in enumerate(sensors)}
    stiff, unit = (gtsam.noiseModel.Isotropic.Sigma(6, sigma) for sigma in (1e-3, 1.0))
    factors = gtsam.NonlinearFactorGraph()
    for name in fixed:
        factors.add(gtsam.PriorFactorPose3(keys[name], gtsam.Pose3(sensors[name]), stiff))
    for pair in pairs:
        assert pair.T_a_b is not None
        T_a_b = gtsam.Pose3(pair.T_a_b)
        factors.add(gtsam.BetweenFactorPose3(keys[pair.a], keys[pair.b], T_a_b, unit))
    try:
        values = gtsam.InitializePose3.initialize(factors)
    except RuntimeError:  # the pairs do not join all sensors
        return dict(sensors)
    found = {s: values.atPose3(key).matrix() for s, key in keys.items() if values.exists(key)}
    return {**sensors, **found, **{s: sensors[s] for s in fixed}}


def graph_error_m2(graph: MsgcalGraph, sensors: Mapping[str, Array]) -> float:
    """Sum of squared errors (m^2) of all edges but sensor-sensor ones, at sensor poses `T_root_s`.

    Solutions of other formulations have no observation nodes; every solution is given those that
    fit it best. So the error depends on the sensors' poses alone, and no solution is charged with
    nodes that it did not choose.
    """
    problem = _Problem.of(MsgcalGraph(graph.exposures), sensors, frozenset(sensors))
    return problem.error_m2(problem.optimise())


@dataclass(frozen=True, eq=False)
class _Problem:
    """The graph as GTSAM sees it: one factor per exposure, which holds all of its edges.

    GTSAM enters Python once per factor, which costs more than the edges do.
    """

    graph: Any
    start: Any
    keys: dict[str, int]
    factors: tuple[tuple[EdgeRows, tuple[int, ...]], ...]

    @staticmethod
    def of(graph: MsgcalGraph, sensors: Mapping[str, Array], fixed: frozenset[str]) -> _Problem:
        import gtsam

        factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        keys = {s: gtsam.symbol("s", i) for i, s in enumerate(sensors)}
        stiff = gtsam.noiseModel.Isotropic.Sigma(6, _FIXED_SIGMA)
        loose = gtsam.noiseModel.Isotropic.Sigma(6, _LOOSE_SIGMA)

        def add(key: int, T: Array, prior: gtsam.noiseModel.Isotropic) -> None:
            values.insert(key, gtsam.Pose3(T))
            factors.add(gtsam.PriorFactorPose3(key, gtsam.Pose3(T), prior))

        for name, T_root_s in sensors.items():
            add(keys[name], T_root_s, stiff if name in fixed else loose)
        parts = []
        for x in graph.exposures:
            at = [gtsam.symbol("o", values.size() + i) for i in range(len(x.nodes))]
            for key, node in zip(at, x.nodes, strict=True):
                add(key, sensors[node.sensor] @ node.T_s_o, loose)
            rows, of_x = EdgeRows.of(x), [*(keys[node.sensor] for node in x.nodes), *at]
            noise = gtsam.noiseModel.Isotropic.Sigma(int(rows.used.sum()), graph.sigma_m)
            factors.add(gtsam.CustomFactor(noise, of_x, _error_function(rows)))
            parts.append((rows, tuple(of_x)))
        for pair in graph.pairs:
            assert pair.T_a_b is not None and pair.covariance is not None  # noqa: PT018
            between, spread = gtsam.Pose3(pair.T_a_b), gtsam.noiseModel.Gaussian
            factors.add(
                gtsam.BetweenFactorPose3(
                    keys[pair.a], keys[pair.b], between, spread.Covariance(pair.covariance)
                )
            )
        return _Problem(factors, values, keys, tuple(parts))

    def optimise(self) -> Any:
        """Values at a minimum (Levenberg-Marquardt)."""
        import gtsam

        parameters = gtsam.LevenbergMarquardtParams()
        parameters.setMaxIterations(_MOST_ITERATIONS)
        parameters.setRelativeErrorTol(1e-9)
        parameters.setAbsoluteErrorTol(1e-9)
        optimizer = gtsam.LevenbergMarquardtOptimizer(self.graph, self.start, parameters)
        values, iterations = optimizer.optimize(), optimizer.iterations()
        cost = optimizer.error()
        if iterations >= _MOST_ITERATIONS or not np.isfinite(cost):
            raise NotConvergedError(
                f"the graph of MSG-Cal did not converge (error {cost:.4g} after {iterations} "
                "iterations); start it from the spanning tree, or leave outliers out"
            )
        return values

    def sensors(self, values: Any) -> dict[str, Array]:
        """`T_root_s` (4, 4) by sensor."""
        return {s: values.atPose3(key).matrix() for s, key in self.keys.items()}

    def error_m2(self, values: Any) -> float:
        """Sum of squares of the edges in metres."""
        return sum(
            float(e @ e)
            for rows, keys in self.factors
            for e in [rows.evaluate(_poses(values, keys), jacobian=False)[0]]
        )

    def covariance(self, values: Any, sensors: Sequence[str]) -> Array:
        """(6 S, 6 S) marginal covariance of sensors."""
        import gtsam

        keys = [self.keys[s] for s in sensors]
        try:
            joint = gtsam.Marginals(self.graph, values).jointMarginalCovariance(keys)
        except RuntimeError as error:
            raise NotDeterminedError(
                "the graph of MSG-Cal leaves a pose open, and so has no covariance; record more, "
                "or use the formulation joint"
            ) from error
        return np.block([[joint.at(i, j) for j in keys] for i in keys])


def _error_function(rows: EdgeRows) -> Callable[[Any, Any, Any], Array]:
    def error(factor: Any, values: Any, jacobians: Any) -> Array:
        T = _poses(values, factor.keys())
        e, J = rows.evaluate(T, jacobian=jacobians is not None)
        if jacobians is not None:
            for i in range(len(T)):
                jacobians[i] = np.asfortranarray(J[:, i])
        return e

    return error


def _poses(values: Any, keys: Sequence[int]) -> Array:
    return np.stack([values.atPose3(key).matrix() for key in keys])
