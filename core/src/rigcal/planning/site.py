"""The rig where it stands, as far as somebody with a board needs to know it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rigcal.exporting.frames import T_BODY_OPTICAL
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.plugin.contract import SensorConfig, SensorType
from rigcal.plugin.registry import Registry
from rigcal.rig import Rig, build_targets
from rigcal.targets.target import Target

# Of the board's diagonal: how far below the lowest and above the highest sensor it can be held.
_BELOW, _ABOVE = 0.35, 0.6
# Beyond the farthest board shown so far, and how much room there is in any case, in diagonals.
_FARTHER, _ROOM = 1.3, 2.5
# Between the board and the rig (m).
_CLEARANCE = 0.3
# Boards that are held all ways have no mean; one within 20 degrees of an axis is that axis.
_AGREE, _LEVEL, _FEW = 0.3, np.cos(np.radians(20.0)), 5


def body_axes(config: SensorConfig) -> Array:
    """`R_s_b` (3, 3): forward, left and up of a sensor, as columns in its frame (REP-103)."""
    result: Array = T_BODY_OPTICAL[:3, :3].T if config.optical else np.eye(3)
    return result


def _up(root: Array, boards: Sequence[Array]) -> Array:
    """(3,) from the root's own up and the boards' y axes in its frame, which are mostly held up.

    An axis of the root that is near to their mean counts: a rig stands level more exactly than
    boards are held, a few of them in particular.
    """
    mean = np.mean(boards, axis=0) if boards else root
    size = float(np.linalg.norm(mean))
    if size < _AGREE:
        return root
    axis = np.argmax(np.abs(mean))
    nearest: Array = np.eye(3)[axis] * np.sign(mean[axis])
    is_near = nearest @ mean / size > _LEVEL
    return nearest if is_near or len(boards) < _FEW else mean / size


@dataclass(frozen=True, eq=False)
class Site:
    """A rig's sensors at `T_root_s`, its targets, and where is up in the root's frame.

    `boards` (N, 3) are corners of boards that have been shown already.
    """

    rig: Rig
    kinds: Mapping[str, SensorType]
    targets: Mapping[str, Target]
    T_root_s: Mapping[str, Array]
    up: Array
    boards: Array

    @staticmethod
    def of(
        rig: Rig,
        registry: Registry,
        T_root_s: Mapping[str, Array],
        boards: Sequence[tuple[str, Array]],
    ) -> Site:
        """`boards` are those recorded, target and `T_root_t`: mostly held upright, they say where
        is up. Without them it is up of the root sensor.
        """
        targets = build_targets(rig, registry)
        kinds = {name: registry.sensor_type(c.type) for name, c in rig.sensors.items()}
        up = _up(body_axes(rig.sensors[rig.root])[:, 2], [T[:3, 1] for _, T in boards])
        corners = [se3.apply(T, targets[name].outline_points) for name, T in boards]
        return Site(rig, kinds, targets, T_root_s, up, np.array(corners).reshape(-1, 3))

    @property
    def places(self) -> Array:
        """(S, 3) of the sensors, in the root's frame."""
        return np.array([T[:3, 3] for T in self.T_root_s.values()])

    def in_reach(self, target: Target, T_root_t: Array) -> bool:
        """Whether somebody can hold the board there.

        That is at about the sensors' heights, or at those where a board has been; and, once boards
        have been shown, not much farther away than they were.
        """
        diagonal = float(np.linalg.norm(target.size))
        heights, shown = self.places @ self.up, self.boards @ self.up
        low = min([heights.min() - _BELOW * diagonal, *shown])
        high = max([heights.max() + _ABOVE * diagonal, *shown])
        corners = se3.apply(T_root_t, target.outline_points)
        level = corners @ self.up
        if level.min() < low or level.max() > high:
            return False
        far = [_FARTHER * float(d) for d in self._away(self.boards)]
        return not far or bool(self._away(corners).max() <= max(*far, _ROOM * diagonal))

    def _away(self, points: Array) -> Array:
        """(N,) how far points (N, 3) are from the middle of the rig."""
        result: Array = np.linalg.norm(points - self.places.mean(axis=0), axis=1)
        return result

    def is_clear(self, target: Target, T_root_t: Array) -> bool:
        """Whether the board keeps away from the sensors and does not stand between two of them."""
        p = se3.apply(se3.inverse(T_root_t), self.places)
        low, high = target.outline.min(axis=0), target.outline.max(axis=0)
        beside = np.column_stack([p[:, :2] - np.clip(p[:, :2], low, high), p[:, 2]])
        if np.linalg.norm(beside, axis=1).min() < _CLEARANCE:
            return False
        a, b = np.triu_indices(len(p), 1)
        crosses = p[a, 2] * p[b, 2] < 0
        a, b = a[crosses], b[crosses]
        share = (p[a, 2] / (p[a, 2] - p[b, 2]))[:, None]
        xy = p[a, :2] + share * (p[b, :2] - p[a, :2])
        inside = np.all((xy > low - _CLEARANCE) & (xy < high + _CLEARANCE), axis=1)
        return not inside.any()


def can_be_planned(kind: SensorType) -> bool:
    """Whether a sensor type says what it would see of a board."""
    return kind.observe is not None or kind.simulate is not None
