"""What the data say at the solution: information of the sensors, covariances, redundancy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rigcal.geometry.se3 import Array
from rigcal.graph.edge import SensorTargetEdge


@dataclass(frozen=True, eq=False)
class EdgeFit:
    """One edge at the solution.

    `chi2` is its sum of squares, `leverage` the part of its rows that the estimate took up: the
    expectation of chi2 is rows - leverage (Huber and Ronchetti, Robust Statistics, ch. 7).
    `misfit` of `misfit_dof` is how far the solution is from what this edge alone would say, as a
    Mahalanobis distance squared: its disagreement with all the others, whatever its own noise.
    """

    edge: SensorTargetEdge
    r: Array
    chi2: float
    leverage: float
    misfit: float
    misfit_dof: int


@dataclass(frozen=True, eq=False)
class Information:
    """`sensors` names the free sensors; `matrix` (6 S, 6 S) is their information after the target
    poses are eliminated (Schur complement), `covariance` its inverse.
    """

    sensors: tuple[str, ...]
    matrix: Array
    covariance: Array
    fits: tuple[EdgeFit, ...]

    def covariance_of(self, sensor: str) -> Array:
        """(6, 6) marginal covariance of a sensor's pose in the root, right perturbation."""
        i = 6 * self.sensors.index(sensor)
        return self.covariance[i : i + 6, i : i + 6]


def information(
    edges: Sequence[SensorTargetEdge],
    sensors: Mapping[str, Array],
    targets: Mapping[str, Array],
    fixed: frozenset[str],
    judged: Sequence[SensorTargetEdge] = (),
) -> Information:
    """Gauss-Newton information of `edges` at their solution, and how every edge fits it.

    `judged` are edges that the solution does not rest on. Their misfit is that of a prediction: it
    counts the covariance of the poses too (an innovation test), and they have no leverage.

    A direction without information gets none: its covariance is infinite in effect (1e12), never
    small. The root and other `fixed` sensors have no block.
    """
    free = tuple(s for s in sensors if s not in fixed)
    at = {s: slice(6 * i, 6 * i + 6) for i, s in enumerate(free)}
    size = 6 * len(free)
    H_ss = np.zeros((size, size))
    H_tt = {k: np.eye(6) * 1e-6 for k in targets}
    H_ts = {k: np.zeros((6, size)) for k in targets}
    parts = [
        (edge, *edge.evaluate(sensors[edge.sensor], targets[edge.exposure]))
        for edge in (*edges, *judged)
    ]
    for edge, _, J_s, J_t in parts[: len(edges)]:
        H_tt[edge.exposure] += J_t.T @ J_t
        if edge.sensor in at:
            i = at[edge.sensor]
            H_ss[i, i] += J_s.T @ J_s
            H_ts[edge.exposure][:, i] += J_t.T @ J_s
    gain = {k: np.linalg.solve(H_tt[k], H_ts[k]) for k in targets}
    matrix = H_ss - sum((H_ts[k].T @ gain[k] for k in targets), np.zeros_like(H_ss))
    covariance = _inverse(matrix)
    inverse_tt = {k: np.linalg.inv(H) for k, H in H_tt.items()}
    fits = []
    for number, (edge, r, J_s, J_t) in enumerate(parts):
        # The edge's rows by the sensors directly, and through the target's dependence on them.
        J = -J_t @ gain[edge.exposure]
        if edge.sensor in at:
            J[:, at[edge.sensor]] += J_s
        U = _column_space(J_t)
        J, J_t = U.T @ J, U.T @ J_t
        predicted = J @ covariance @ J.T + J_t @ inverse_tt[edge.exposure] @ J_t.T
        u = U.T @ r
        if number < len(edges):
            leverage, misfit = float(np.trace(predicted)), float(u @ u)
        else:
            leverage, misfit = 0.0, float(u @ np.linalg.solve(np.eye(len(u)) + predicted, u))
        fits.append(EdgeFit(edge, r, float(r @ r), leverage, misfit, len(u)))
    return Information(free, matrix, covariance, tuple(fits))


def _column_space(J_t: Array) -> Array:
    """(m, k) orthonormal basis of what the edge's rows can say of the target's pose."""
    U, s, _ = np.linalg.svd(J_t, full_matrices=False)
    rank = int(np.count_nonzero(s > 1e-9 * s[0])) if len(s) and s[0] > 0 else 0
    result: Array = U[:, :rank]
    return result


def _inverse(matrix: Array) -> Array:
    """Inverse of a symmetric matrix; directions without information get a variance of 1e12."""
    if not len(matrix):
        return matrix
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    result: Array = (vectors / np.maximum(values, 1e-12)) @ vectors.T
    return result
