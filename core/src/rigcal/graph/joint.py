"""The joint formulation: maximum likelihood over sensors and target poses, solved by GTSAM.

Levenberg-Marquardt (K. Madsen, H. B. Nielsen, O. Tingleff, Methods for Non-Linear Least Squares
Problems, 2004, ch. 3). All edges are evaluated in a few calls of numpy; GTSAM gets one factor per
edge, already linear, and eliminates the targets before the sensors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigcal.errors import NotConvergedError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.edge import SensorTargetEdge
from rigcal.graph.linear import LinearSystem
from rigcal.graph.numbers import NO_NUMBERS, Numbers
from rigcal.graph.stack import Blocks, EdgeStack, poses_of

HUBER_K = 1.5
_MOST_ITERATIONS = 100
# Damping in shares of the information's diagonal. Only a step that it hardly shortens tells
# whether the minimum is reached.
_LEAST_DAMPING, _FREE_DAMPING, _MOST_DAMPING = 1e-9, 1e-3, 1e6
# A step that promises less than this share of the cost is the last. The robust stage is a start
# only. A step that promises little and does not keep it is rounding, or a Jacobian that is.
_TOLERANCE, _ROBUST_TOLERANCE, _ROUNDING = 1e-11, 1e-4, 1e-8
# How tightly an anchor holds (rad, m): far looser than data, tight enough for what they leave open.
_ANCHOR = 1 / np.array([0.05, 0.05, 0.05, 0.15, 0.15, 0.15]) ** 2
_FAR_M = 1e4


class Found(NamedTuple):
    """`T_root_s` by sensor, `T_root_t` by exposure, and the numbers beside them."""

    sensors: dict[str, Array]
    targets: dict[str, Array]
    numbers: Numbers


def solve(
    edges: Sequence[SensorTargetEdge],
    sensors: Mapping[str, Array],
    targets: Mapping[str, Array],
    fixed: frozenset[str],
    numbers: Numbers = NO_NUMBERS,
    anchor: Mapping[str, Array] | None = None,
) -> Found:
    """Sensor poses `T_root_s` and target poses `T_root_t` that minimise the sum of squares.

    `sensors` and `targets` hold first poses (4, 4); those named in `fixed` (the root among them)
    stay as they are. `numbers` are estimated with them, from their values on. An `anchor` holds
    sensors near its poses in directions that the data leave open. NotConvergedError if the minimum
    was not reached; PluginError if a residual breaks its contract.
    """
    found, problem = _minimise(edges, sensors, targets, fixed, numbers, anchor, np.inf, _TOLERANCE)
    if problem:
        raise NotConvergedError(
            f"the global estimate did not converge: {problem}. Check the sensors' intrinsics and "
            "the target's size in the rig file"
        )
    return found


def solve_robust(
    edges: Sequence[SensorTargetEdge],
    sensors: Mapping[str, Array],
    targets: Mapping[str, Array],
    fixed: frozenset[str],
    numbers: Numbers = NO_NUMBERS,
    anchor: Mapping[str, Array] | None = None,
) -> Found:
    """The same with Huber's loss on each block, by iteratively reweighted least squares.

    (P. J. Huber, Robust Statistics, 1981, ch. 7.) It serves as a start that outliers have not
    dragged away, so it stops early.
    """
    return _minimise(edges, sensors, targets, fixed, numbers, anchor, HUBER_K, _ROBUST_TOLERANCE)[0]


@dataclass(frozen=True, eq=False)
class _State:
    """Poses (S, 4, 4), (K, 4, 4), numbers, and the edges' normal equations there."""

    T_root_s: Array
    T_root_t: Array
    numbers: Numbers
    T_s_t: Array
    blocks: Blocks
    chi2: float
    off_anchor: Array


def _minimise(
    edges: Sequence[SensorTargetEdge],
    sensors: Mapping[str, Array],
    targets: Mapping[str, Array],
    fixed: frozenset[str],
    numbers: Numbers,
    anchor: Mapping[str, Array] | None,
    huber_k: float,
    tolerance: float,
) -> tuple[Found, str]:
    """The best poses and numbers, and why they are not the minimum; empty if they are."""
    stack = EdgeStack(edges, list(sensors), list(targets), numbers)
    free = np.array([s not in fixed for s in sensors], dtype=bool)
    held = np.zeros(6) if anchor is None else _ANCHOR
    system = LinearSystem(stack.sensor, stack.exposure, free, len(targets), numbers, held)
    at = poses_of({s: (anchor or sensors)[s] for s in sensors})

    def state_at(T_root_s: Array, T_root_t: Array, numbers: Numbers) -> _State:
        off = se3.log(se3.inverse(at) @ T_root_s) * np.sqrt(held)
        return _state(stack, T_root_s, T_root_t, numbers, huber_k, off)

    state = state_at(poses_of(sensors), poses_of(targets), numbers)
    stack.check(state.T_s_t, numbers)
    damping, problem = _LEAST_DAMPING, "its steps do not end"
    for _ in range(_MOST_ITERATIONS):
        try:
            step_s, step_t, step_n, promised = system.solve(
                state.blocks, state.T_s_t, state.numbers, state.off_anchor, damping
            )
        except RuntimeError:  # of GTSAM
            problem = "its normal equations have no solution"
            break
        T_root_s, T_root_t = state.T_root_s @ se3.exp(step_s), state.T_root_t @ se3.exp(step_t)
        trial = state_at(T_root_s, T_root_t, state.numbers.stepped(step_n))
        share = promised / (1 + state.chi2)
        is_last = share <= (tolerance if trial.chi2 <= state.chi2 else _ROUNDING)
        if trial.chi2 < state.chi2 and _is_near(trial):
            state, damping = trial, max(damping / 10, _LEAST_DAMPING)
        elif damping > _MOST_DAMPING:
            problem = "no step lowers its error"
            break
        else:
            damping *= 100
        if is_last and damping <= _FREE_DAMPING:
            problem = _unseen(stack, state, list(sensors), free)
            break
    return Found(
        dict(zip(sensors, state.T_root_s, strict=True)),
        dict(zip(targets, state.T_root_t, strict=True)),
        state.numbers,
    ), problem


def _state(
    stack: EdgeStack,
    T_root_s: Array,
    T_root_t: Array,
    numbers: Numbers,
    huber_k: float,
    off_anchor: Array,
) -> _State:
    """`off_anchor` (S, 6): how far the sensors are from their anchors, in standard deviations."""
    T_s_t = stack.relative(T_root_s, T_root_t)
    blocks = stack.blocks(T_s_t, huber_k, numbers)
    chi2 = float(blocks.chi2.sum())
    chi2 += float(numbers.known @ numbers.off_start**2) + float(np.sum(off_anchor**2))
    return _State(T_root_s, T_root_t, numbers, T_s_t, blocks, chi2, off_anchor)


def _is_near(state: _State) -> bool:
    places = np.concatenate([state.T_root_s, state.T_root_t])[:, :3, 3]
    return bool(np.abs(places).max(initial=0.0) < _FAR_M)


def _unseen(
    stack: EdgeStack, state: _State, sensors: Sequence[str], free: NDArray[np.bool_]
) -> str:
    """Names a sensor that stands still only because no residual of its depends on its pose."""
    says_nothing = np.abs(state.blocks.H[:, :6, :6]).max(axis=(1, 2), initial=0.0) == 0
    for i in np.flatnonzero(free).tolist():
        own = stack.sensor == i
        if own.any() and says_nothing[own].all():
            return (
                f"from where '{sensors[i]}' has come to, none of its targets is in its view; it "
                "needs better first poses (`initial: pose` in the rig file)"
            )
    return ""
