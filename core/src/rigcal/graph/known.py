"""What the data know of the sensors beyond what their noise feigns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.edge import SensorTargetEdge
from rigcal.graph.information import SensorInformation
from rigcal.graph.numbers import NO_NUMBERS, Numbers
from rigcal.graph.stack import poses_of

# Information counts as far as it exceeds so many times what the noise feigns on average.
_NOISE_FACTOR = 4.0
# Boards are moved by their uncertainty, but where it is open no farther than this (rad, m).
_FARTHEST = 0.05


def known_information(
    edges: Sequence[SensorTargetEdge],
    sensors: Mapping[str, Array],
    targets: Mapping[str, Array],
    fixed: frozenset[str],
    numbers: Numbers = NO_NUMBERS,
) -> Array:
    """(6 S + Q, 6 S + Q) information of the free sensors and the numbers that the data do hold.

    Information is evaluated at boards as they were estimated. Their noise makes boards differ that
    do not, and parallel boards feign a pose. On average it adds the second-order term of the
    information in the boards' covariances, which is found by moving all boards along each of their
    six principal axes, both ways, by a standard deviation. Four times that is taken off.
    """
    held = SensorInformation(edges, sensors, list(targets), fixed, numbers)
    T_root_t = poses_of(targets)
    matrix, covariances = held.at(T_root_t)
    variances, axes = np.linalg.eigh(covariances)
    steps = axes * np.sqrt(np.clip(variances, 0.0, _FARTHEST**2))[:, None, :]
    feigned = np.zeros_like(matrix)
    for i in range(6):
        moved = (T_root_t @ se3.exp(sign * steps[:, :, i]) for sign in (1, -1))
        there, back = (held.at(poses)[0] for poses in moved)
        feigned += (there + back) / 2 - matrix
    result: Array = matrix - _NOISE_FACTOR * feigned
    return result
