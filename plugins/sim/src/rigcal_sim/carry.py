"""How the board is carried from pose to pose and held still at each."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal_sim.poses import stream
from rigcal_sim.timing import ContinuousConfig

_PEAK = 15 / 8
"""Highest speed of `ease`, of its mean speed."""
_STRAIGHT_RAD = np.pi / 2
_SAMPLES = np.linspace(0.0, 1.0, 33)
_WAVES = 6
_TREMOR_HZ = (1.0, 12.0)
_Z = np.array([0.0, 0.0, 1.0])


def ease(share: Array) -> Array:
    """Way done (...) after a share (...) of the time, at rest at both ends.

    The motion of least jerk from rest to rest (Flash and Hogan, 1985), which hands make.
    """
    s = np.clip(share, 0.0, 1.0)
    result: Array = s**3 * (10 - 15 * s + 6 * s**2)
    return result


@dataclass(frozen=True, eq=False)
class Leg:
    """The way between two poses (4, 4): straight, or around the z axis where that is far.

    The latter so that nobody walks through the rig: both ends are taken in a frame that turns
    by `turn` rad about the z axis on the way.
    """

    start: Array
    end: Array

    @property
    def turn(self) -> float:
        """Angle about the z axis, rad; 0 for a straight way."""
        first, last = (np.arctan2(T[1, 3], T[0, 3]) for T in (self.start, self.end))
        turn = float((last - first + np.pi) % (2 * np.pi) - np.pi)
        return turn if abs(turn) > _STRAIGHT_RAD else 0.0

    def poses(self, way: Array) -> Array:
        """(N, 4, 4) after shares (N,) of the way: rotations along the geodesic."""
        T_end = se3.transform(se3.exp_so3(-self.turn * _Z), np.zeros(3)) @ self.end
        rotation = se3.log_so3(self.start[:3, :3].T @ T_end[:3, :3])
        R = self.start[:3, :3] @ se3.exp_so3(way[:, None] * rotation)
        p = self.start[:3, 3] + way[:, None] * (T_end[:3, 3] - self.start[:3, 3])
        T_turned = se3.transform(se3.exp_so3(self.turn * way[:, None] * _Z), np.zeros(3))
        result: Array = T_turned @ se3.transform(R, p)
        return result

    def duration_s(self, config: ContinuousConfig) -> float:
        """Time for the way, at the highest speed and turn rate at its middle."""
        T = self.poses(_SAMPLES)
        length = np.linalg.norm(np.diff(T[:, :3, 3], axis=0), axis=1).sum()
        angle = se3.rotation_angle(T[:-1, :3, :3].swapaxes(1, 2) @ T[1:, :3, :3]).sum()
        at_speed = max(length / config.speed_m_s, angle / np.radians(config.turn_deg_s))
        return _PEAK * float(at_speed)


@dataclass(frozen=True, eq=False)
class Tremor:
    """The shaking of hands: sines of random frequency and phase in each direction."""

    sigma: Array
    """(6,) [rotation rad, translation m]."""
    frequency_hz: Array
    phase: Array

    def at(self, times_s: Array) -> Array:
        """(M, 4, 4) motion away from the pose meant, in the board's frame."""
        if not self.sigma.any():
            return np.broadcast_to(np.eye(4), (len(times_s), 4, 4))
        angle = 2 * np.pi * self.frequency_hz * times_s[:, None, None] + self.phase
        return se3.exp(self.sigma * np.sqrt(2 / _WAVES) * np.sin(angle).sum(axis=-1))


@dataclass(frozen=True, eq=False)
class Carrying:
    """The board's motion: poses (N, 4, 4) in the order of visit, held from `start_s` (N,) on."""

    T_w_t: Array
    start_s: Array
    hold_s: float
    tremor: Tremor

    @property
    def end_s(self) -> float:
        """When the last hold ends; the first begins at 0."""
        return float(self.start_s[-1]) + self.hold_s

    def at(self, times_s: Array) -> tuple[Array, NDArray[np.int64]]:
        """`T_w_t` (M, 4, 4) at times (M,), and the number of the hold, or the last one, (M,)."""
        number = np.searchsorted(self.start_s, times_s, side="right").astype(np.int64) - 1
        number = np.clip(number, 0, len(self.start_s) - 1)
        T_w_t = self.T_w_t[number].copy()
        for k in np.unique(number[number < len(self.start_s) - 1]):
            leave = self.start_s[k] + self.hold_s
            under_way = (number == k) & (times_s > leave)
            share = (times_s[under_way] - leave) / (self.start_s[k + 1] - leave)
            T_w_t[under_way] = Leg(self.T_w_t[k], self.T_w_t[k + 1]).poses(ease(share))
        return T_w_t @ self.tremor.at(times_s), number


def carry(T_w_t: Array, config: ContinuousConfig, seed: int) -> Carrying:
    """The motion along poses (N, 4, 4) in their order."""
    legs = [Leg(a, b) for a, b in itertools.pairwise(T_w_t)]
    steps = [config.hold_s + leg.duration_s(config) for leg in legs]
    rng = stream(seed, 0, "tremor")
    tremor = Tremor(
        np.repeat([np.radians(config.tremor_deg), config.tremor_mm / 1000], 3),
        rng.uniform(*_TREMOR_HZ, (6, _WAVES)),
        rng.uniform(0, 2 * np.pi, (6, _WAVES)),
    )
    return Carrying(T_w_t, np.concatenate([[0.0], np.cumsum(steps)]), config.hold_s, tremor)


def tour(T_w_t: Array) -> list[int]:
    """A short way through all poses (N, 4, 4) from the first: nearest next, then 2-opt.

    A metre counts as much as a radian of turn.
    """
    position, R = T_w_t[:, :3, 3], T_w_t[:, :3, :3]
    cost = np.linalg.norm(position[:, None] - position, axis=2)
    cost += se3.rotation_angle(R[:, None].swapaxes(-1, -2) @ R[None])
    order, left = [0], set(range(1, len(T_w_t)))
    while left:
        order.append(min(left, key=lambda k: (cost[order[-1], k], k)))
        left.remove(order[-1])
    while len(order) > 2 and (better := _without_crossing(order, cost)) is not None:
        order = better
    return order


def _without_crossing(order: list[int], cost: Array) -> list[int] | None:
    """The way with the one part reversed that shortens it most, or None (Croes, 1958)."""
    way = np.array(order)
    step = np.append(cost[way[:-1], way[1:]], 0.0)
    between = cost[np.ix_(way, way)]
    # Reversing positions i..j replaces the steps into i and out of j; the end is open.
    beyond = np.column_stack([between[:, 1:], np.zeros(len(way))])
    saved = step[:-1, None] + step[None, 1:] - between[:-1, 1:] - beyond[1:, 1:]
    i, j = np.unravel_index(np.argmax(np.triu(saved)), saved.shape)
    if saved[i, j] < 1e-9 or i > j:
        return None
    return [*order[: i + 1], *order[i + 1 : j + 2][::-1], *order[j + 2 :]]
