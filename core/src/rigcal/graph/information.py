"""What the data say at the solution: information of the sensors, covariances, redundancy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.edge import SensorTargetEdge
from rigcal.graph.numbers import NO_NUMBERS, Numbers
from rigcal.graph.stack import Blocks, EdgeStack, Index, poses_of

# Smaller eigenvalues of an edge's information, by the largest, are rounding.
_RANK = 1e-12
# What a target's information is lifted by, of its trace.
_RIDGE = 1e-14


@dataclass(frozen=True, eq=False)
class EdgeFit:
    """One edge at the solution.

    `chi2` is its sum of squares, `leverage` the part of its rows that the estimate took up: the
    expectation of chi2 is rows - leverage (Huber and Ronchetti, Robust Statistics, ch. 7).
    `misfit` of `misfit_dof` is how far the solution is from what this edge alone would say, as a
    Mahalanobis distance squared: its disagreement with all the others, whatever its own noise.
    """

    edge: SensorTargetEdge
    chi2: float
    leverage: float
    misfit: float
    misfit_dof: int


@dataclass(frozen=True, eq=False)
class Information:
    """`sensors` names the free sensors; `covariance` (6 S + Q, 6 S + Q) of their poses and the Q
    numbers (in units) is the inverse of their information after the target poses are eliminated
    (Schur complement).
    """

    sensors: tuple[str, ...]
    covariance: Array
    fits: tuple[EdgeFit, ...]

    def covariance_of(self, sensor: str) -> Array:
        """(6, 6) marginal covariance of a sensor's pose in the root, right perturbation."""
        i = 6 * self.sensors.index(sensor)
        return self.covariance[i : i + 6, i : i + 6]

    @property
    def covariance_of_numbers(self) -> Array:
        """(Q, Q) marginal covariance of the numbers, in units."""
        i = 6 * len(self.sensors)
        return self.covariance[i:, i:]


def information(
    edges: Sequence[SensorTargetEdge],
    sensors: Mapping[str, Array],
    targets: Mapping[str, Array],
    fixed: frozenset[str],
    judged: Sequence[SensorTargetEdge] = (),
    numbers: Numbers = NO_NUMBERS,
) -> Information:
    """Gauss-Newton information of `edges` at their solution, and how every edge fits it.

    `judged` are edges that the solution does not rest on. Their misfit is that of a prediction: it
    counts the covariance of the poses too (an innovation test), and they have no leverage.

    A direction without information gets none: its covariance is infinite in effect (1e12), never
    small. The root and other `fixed` sensors have no block.
    """
    every = (*edges, *judged)
    stack = EdgeStack(every, list(sensors), list(targets), numbers)
    T_s_t = stack.relative(poses_of(sensors), poses_of(targets))
    stack.check(T_s_t, numbers)
    blocks = stack.blocks(T_s_t, numbers=numbers)
    free = tuple(s for s in sensors if s not in fixed)
    ends = Ends(_columns(every, free), stack.exposure, se3.adjoint(se3.inverse(T_s_t)))
    rests = np.arange(len(every)) < len(edges)
    matrix, gain, inverse_tt = eliminate(
        blocks.H * rests[:, None, None], ends, len(free), len(targets), numbers
    )
    covariance, root = _inverse(matrix)
    predicted = _predicted(ends, gain, inverse_tt, root, len(numbers))
    leverage = np.where(rests, np.einsum("eij,eji->e", predicted, blocks.H), 0.0)
    misfit, dof = _misfit(blocks, np.where(rests[:, None, None], 0.0, predicted))
    columns = blocks.chi2, leverage, misfit, dof
    fits = tuple(map(EdgeFit, every, *(c.tolist() for c in columns)))
    return Information(free, covariance, fits)


class SensorInformation:
    """Information of the free sensors and the numbers from edges alone, wherever the targets are.

    What was known of numbers beforehand counts.
    """

    def __init__(
        self,
        edges: Sequence[SensorTargetEdge],
        sensors: Mapping[str, Array],
        targets: Sequence[str],
        fixed: frozenset[str],
        numbers: Numbers = NO_NUMBERS,
    ) -> None:
        self._stack, self._numbers = EdgeStack(edges, list(sensors), targets, numbers), numbers
        self._T_root_s = poses_of(sensors)
        self._targets = len(targets)
        free = [s for s in sensors if s not in fixed]
        self._columns, self._free = _columns(edges, free), len(free)

    def at(self, T_root_t: Array) -> tuple[Array, Array]:
        """(6 S + Q, 6 S + Q) with the targets at poses (K, 4, 4).

        With it the covariance (K, 6, 6) that each target would have if the rest were known.
        """
        T_s_t = self._stack.relative(self._T_root_s, T_root_t)
        ends = Ends(self._columns, self._stack.exposure, se3.adjoint(se3.inverse(T_s_t)))
        H = self._stack.blocks(T_s_t, numbers=self._numbers).H
        matrix, _, covariances = eliminate(H, ends, self._free, self._targets, self._numbers)
        return matrix, covariances


@dataclass(frozen=True, eq=False)
class Ends:
    """How `T_s_t` of E edges moves: by the target's perturbation as it is, by the sensor's by -A.

    column (E,) numbers the free sensors, -1 for a fixed one; A (E, 6, 6) is the adjoint of T_t_s.
    """

    column: Index
    exposure: Index
    A: Array


def _columns(edges: Sequence[SensorTargetEdge], free: Sequence[str]) -> Index:
    number = {s: i for i, s in enumerate(free)}
    return np.array([number.get(e.sensor, -1) for e in edges], dtype=np.int64)


def eliminate(
    H: Array, ends: Ends, sensors: int, targets: int, numbers: Numbers
) -> tuple[Array, Array, Array]:
    """Information of sensors and numbers (6 S + Q, 6 S + Q) without the targets.

    With it the targets' dependence on them, gain (K, 6, 6 S + Q), and the inverse of their own
    information (K, 6, 6).
    """
    H_tt = np.tile(np.eye(6) * 1e-6, (targets, 1, 1))
    np.add.at(H_tt, ends.exposure, H[:, :6, :6])
    # A board that one sensor saw, far off and unfiltered, may be open in a direction to rounding.
    H_tt += _RIDGE * np.trace(H_tt, axis1=1, axis2=2)[:, None, None] * np.eye(6)
    own = ends.column >= 0
    s, k, A = ends.column[own], ends.exposure[own], ends.A[own]
    H_ts = np.zeros((targets, sensors, 6, 6))
    J = -H[own, :6, :6] @ A
    np.add.at(H_ts, (k, s), J)
    H_ss = np.zeros((sensors, sensors, 6, 6))
    np.add.at(H_ss, (s, s), -np.swapaxes(A, 1, 2) @ J)
    H_tn, H_sn = np.zeros((targets, 6, len(numbers))), np.zeros((sensors, 6, len(numbers)))
    np.add.at(H_tn, ends.exposure, H[:, :6, 6:])
    np.add.at(H_sn, s, -np.swapaxes(A, 1, 2) @ H[own, :6, 6:])
    H_nn = H[:, 6:, 6:].sum(axis=0) + np.diag(numbers.known)
    dense = np.swapaxes(H_ss, 1, 2).reshape(6 * sensors, 6 * sensors)
    beside = H_sn.reshape(6 * sensors, len(numbers))
    dense = np.block([[dense, beside], [beside.T, H_nn]])
    rows = np.swapaxes(H_ts, 1, 2).reshape(targets, 6, 6 * sensors)
    rows = np.concatenate([rows, H_tn], axis=2)
    gain = np.asarray(np.linalg.solve(H_tt, rows), dtype=np.float64)
    matrix: Array = dense - np.tensordot(rows, gain, ((0, 1), (0, 1)))
    return matrix, gain, np.asarray(np.linalg.inv(H_tt), dtype=np.float64)


def _predicted(ends: Ends, gain: Array, inverse_tt: Array, root: Array, numbers: int) -> Array:
    """(E, 6 + Q, 6 + Q) covariances of `T_s_t` and the numbers, by that of sensors and numbers.

    That covariance is `root root^T`. The dependence of `T_s_t` through the target and the direct
    one are added before they are squared: in a direction that the data leave open both are huge
    and cancel.
    """
    through, direct = gain @ root, root[len(root) - numbers :]
    result = np.zeros((len(ends.column), 6 + numbers, 6 + numbers))
    result[:, :6, :6] = inverse_tt[ends.exposure]
    for column in np.unique(ends.column):
        own = ends.column == column
        rows = through[ends.exposure[own]]
        if column >= 0:
            rows = rows + ends.A[own] @ root[6 * column : 6 * column + 6]
        rows = np.concatenate([rows, np.tile(-direct, (len(rows), 1, 1))], axis=1)
        result[own] += rows @ np.swapaxes(rows, 1, 2)
    return result


def _misfit(blocks: Blocks, predicted: Array) -> tuple[Array, Index]:
    """Misfit (E,) and its degrees of freedom, in the span of what an edge can say of `T_s_t`."""
    values, vectors = np.linalg.eigh(blocks.H[:, :6, :6])
    known = values > _RANK * np.maximum(values[:, -1:], 1e-300)
    scale = np.sqrt(np.where(known, values, 0.0))
    u = np.einsum("eji,ej->ei", vectors, blocks.g[:, :6]) * known / np.where(known, scale, 1.0)
    basis = vectors * scale[:, None, :]
    spread = np.eye(6) + np.swapaxes(basis, 1, 2) @ predicted[:, :6, :6] @ basis
    misfit = np.sum(u * np.linalg.solve(spread, u[..., None])[..., 0], axis=1)
    return misfit, known.sum(axis=1)


def _inverse(matrix: Array) -> tuple[Array, Array]:
    """Inverse of a symmetric matrix and a root of it, `root root^T`.

    Directions without information get a variance of 1e12.
    """
    if not len(matrix):
        return matrix, matrix
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    root = vectors / np.sqrt(np.maximum(values, 1e-12))
    return root @ root.T, root
