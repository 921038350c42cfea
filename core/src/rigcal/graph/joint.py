"""The joint formulation: maximum likelihood over sensors and target poses, solved by GTSAM."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from rigcal.errors import NotConvergedError
from rigcal.geometry.se3 import Array
from rigcal.graph.edge import SensorTargetEdge, huber_weights

HUBER_K = 1.5
# Wide enough to leave what the data know alone, and to close what they leave open in an exposure
# that shows only planes: the target's place and turn in its own plane.
_OPEN_TARGET_SIGMAS = np.array([3.0, 3.0, 3.0, 10.0, 10.0, 10.0])
_MOST_ITERATIONS = 100
_ROUNDS, _ITERATIONS_PER_ROUND = 15, 4
_FAR_M = 1e4

Poses = tuple[dict[str, Array], dict[str, Array]]
"""`T_root_s` by sensor and `T_root_t` by exposure."""


def solve(
    edges: Sequence[SensorTargetEdge],
    sensors: Mapping[str, Array],
    targets: Mapping[str, Array],
    fixed: frozenset[str],
) -> Poses:
    """Sensor poses `T_root_s` and target poses `T_root_t` that minimise the sum of squares.

    `sensors` and `targets` hold first poses (4, 4); those named in `fixed` (the root among them)
    stay as they are. One factor per edge, evaluated as one numpy call. NotConvergedError if the
    minimum was not reached.
    """
    return _minimise(edges, (dict(sensors), dict(targets)), fixed, {}, _MOST_ITERATIONS)


def solve_robust(
    edges: Sequence[SensorTargetEdge],
    sensors: Mapping[str, Array],
    targets: Mapping[str, Array],
    fixed: frozenset[str],
) -> Poses:
    """The same with Huber's loss on each block, by iteratively reweighted least squares.

    (P. J. Huber, Robust Statistics, 1981, ch. 7.) It serves as a start that outliers have not
    dragged away, so it stops when the weights hardly change.
    """
    poses: Poses = dict(sensors), dict(targets)
    weights: dict[int, Array] = {}
    for _ in range(_ROUNDS):
        before = weights
        weights = {}
        for i, edge in enumerate(edges):
            r, _, _ = edge.evaluate(poses[0][edge.sensor], poses[1][edge.exposure])
            weights[i] = huber_weights(r, edge.residual.block, HUBER_K)
        if before and max(float(np.abs(weights[i] - before[i]).max()) for i in weights) < 0.05:
            break
        poses = _minimise(edges, poses, fixed, weights, _ITERATIONS_PER_ROUND)
    return poses


def _minimise(
    edges: Sequence[SensorTargetEdge],
    poses: Poses,
    fixed: frozenset[str],
    weights: Mapping[int, Array],
    iterations: int,
) -> Poses:
    """Weighted least squares; `weights` (m,) multiply the rows of an edge, by its number."""
    import gtsam

    sensors, targets = poses
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    sensor_keys = {s: gtsam.symbol("s", i) for i, s in enumerate(sensors) if s not in fixed}
    target_keys = {k: gtsam.symbol("t", i) for i, k in enumerate(targets)}
    for name, key in sensor_keys.items():
        values.insert(key, gtsam.Pose3(sensors[name]))
    weak = gtsam.noiseModel.Diagonal.Sigmas(_OPEN_TARGET_SIGMAS)
    for exposure, key in target_keys.items():
        values.insert(key, gtsam.Pose3(targets[exposure]))
        graph.add(gtsam.PriorFactorPose3(key, gtsam.Pose3(targets[exposure]), weak))
    for i, edge in enumerate(edges):
        keys = [target_keys[edge.exposure]]
        if edge.sensor in sensor_keys:
            keys.insert(0, sensor_keys[edge.sensor])
        noise = gtsam.noiseModel.Unit.Create(edge.rows)
        error = _error_function(edge, sensors[edge.sensor], weights.get(i))
        graph.add(gtsam.CustomFactor(noise, keys, error))
    values = _optimise(gtsam, graph, values, iterations)
    return (
        {
            s: values.atPose3(sensor_keys[s]).matrix() if s in sensor_keys else T
            for s, T in sensors.items()
        },
        {k: values.atPose3(key).matrix() for k, key in target_keys.items()},
    )


def _error_function(
    edge: SensorTargetEdge, T_root_s_fixed: Array, weights: Array | None
) -> Callable[[Any, Any, Any], Array]:
    def error(factor: Any, values: Any, jacobians: Any) -> Array:
        keys = factor.keys()
        free = len(keys) == 2
        T_root_s = values.atPose3(keys[0]).matrix() if free else T_root_s_fixed
        r, J_s, J_t = edge.evaluate(T_root_s, values.atPose3(keys[-1]).matrix())
        if weights is not None:
            r, J_s, J_t = weights * r, weights[:, None] * J_s, weights[:, None] * J_t
        if jacobians is not None:
            if free:
                jacobians[0] = np.asfortranarray(J_s)
            jacobians[-1] = np.asfortranarray(J_t)
        return r

    return error


def _optimise(gtsam: Any, graph: Any, values: Any, iterations: int) -> Any:
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setMaxIterations(iterations)
    parameters.setRelativeErrorTol(1e-9)
    parameters.setAbsoluteErrorTol(1e-9)
    optimizer = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters)
    result = optimizer.optimize()
    unfinished = optimizer.iterations() >= _MOST_ITERATIONS
    if unfinished or not np.isfinite(optimizer.error()) or _has_diverged(gtsam, result):
        raise NotConvergedError(
            f"the global estimate did not converge (error {optimizer.error():.4g} after "
            f"{optimizer.iterations()} iterations); check the sensors' intrinsics and the target's "
            "size in the rig file"
        )
    return result


def _has_diverged(gtsam: Any, values: Any) -> bool:
    places = gtsam.utilities.extractPose3(values)[:, 9:]
    return bool(not np.isfinite(places).all() or np.abs(places).max() > _FAR_M)
