"""Board poses that cover the views of a rig's sensors: near and far, middle and borders."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rigcal.errors import ConfigError
from rigcal.geometry import se3
from rigcal.geometry.directions import circle, sphere
from rigcal.geometry.se3 import Array
from rigcal.plugin import Registry
from rigcal.rig import Rig
from rigcal.targets import Target
from rigcal_sim.boards import CoverConfig
from rigcal_sim.poses import facing

_DIRECTIONS = 4000
_CELLS = 30
_DISTANCES = 3
_SHIFT = 0.4


class Coverage:
    """How often boards have been shown in each part of each sensor's view.

    A view is the set of directions that the sensor sees between the nearest and the farthest
    distance. It is parted into 30 directions, evenly apart (the first on the border), times 3
    distances in equal ratio. ConfigError if no sensor sees anything there.
    """

    def __init__(
        self,
        config: CoverConfig,
        rig: Rig,
        registry: Registry,
        target: Target,
        T_w_s: Mapping[str, Array],
    ) -> None:
        near, far = config.distances_m(target)
        self._config, self._target, self._T_w_s = config, target, T_w_s
        self.distances = np.geomspace(near, far, _DISTANCES + 1)
        self._views: dict[str, Array] = {}
        for name, sensor in rig.sensors.items():
            kind = registry.sensor_type(sensor.type)
            middle = np.sqrt(self.distances[1:] * self.distances[:-1])
            d_s = circle(_DIRECTIONS) if kind.flat else sphere(_DIRECTIONS)
            seen = np.ones(len(d_s), bool)
            if kind.sees is not None:
                seen = np.any([kind.sees(r * d_s, sensor) for r in middle], axis=0)
            if rig.target_of(name) == target.name and seen.any():
                self._views[name] = d_s[seen]
        if not self._views:
            raise ConfigError(
                f"scenario: no sensor sees anything {near:.3g} to {far:.3g} m away: "
                "change board.distance_m"
            )
        self._cells = {name: spread(d_s, _CELLS) for name, d_s in self._views.items()}
        self.counts = {
            name: np.zeros((len(cells), _DISTANCES), int) for name, cells in self._cells.items()
        }
        """By sensor: (directions, distances) how many boards were shown there."""

    def draw(self, rng: np.random.Generator) -> Array:
        """`T_w_t` (4, 4): some point of the board anywhere in the view of some sensor."""
        name = list(self._views)[rng.integers(len(self._views))]
        d_s = self._views[name][rng.integers(len(self._views[name]))]
        near, far = self.distances[[0, -1]]
        distance = near * (far / near) ** rng.uniform()
        away = self._T_w_s[name][:3, :3] @ d_s
        p_w = self._T_w_s[name][:3, 3] + distance * away
        shift = rng.uniform(-_SHIFT, _SHIFT, 2) * self._target.size
        T_t_centre = se3.transform(np.eye(3), np.array([*shift, 0.0]))
        return facing(away, p_w, self._config.draw_rpy_deg(rng)) @ T_t_centre

    def gain(self, spots: Mapping[str, Array]) -> float:
        """How new a board is that the sensors see at `spots` (N, 3): 1 per sensor if all new."""
        cells = {name: self._cells_of(name, p_s) for name, p_s in spots.items()}
        return sum(float(np.mean(1 / (1 + self.counts[name][at]))) for name, at in cells.items())

    def add(self, spots: Mapping[str, Array]) -> None:
        """Count a board that the sensors see at `spots` (N, 3), in their frames."""
        for name, p_s in spots.items():
            shown = np.zeros_like(self.counts[name], bool)
            shown[self._cells_of(name, p_s)] = True
            self.counts[name] += shown

    def _cells_of(self, name: str, p_s: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        distance = np.linalg.norm(p_s, axis=1)
        direction = np.argmax((p_s / distance[:, None]) @ self._cells[name].T, axis=1)
        return direction, np.searchsorted(self.distances[1:-1], distance)


def spread(directions: Array, count: int) -> Array:
    """(K, 3) up to `count` of the unit directions (N, 3), far apart, those on the border first.

    Each is the farthest from those before it (Gonzalez, 1985).
    """
    cosine = directions @ directions.mean(axis=0)
    chosen: list[int] = []
    nearest = np.full(len(directions), -2.0)
    for _ in range(min(count, len(directions))):
        chosen.append(int(np.argmin(nearest if chosen else cosine)))
        nearest = np.maximum(nearest, directions @ directions[chosen[-1]])
    result: Array = directions[chosen]
    return result
