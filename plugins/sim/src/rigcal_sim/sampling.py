"""Random poses of the board, as the scenario's `board` section wants them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from rigcal.errors import ConfigError
from rigcal.geometry.se3 import Array
from rigcal.plugin import Registry
from rigcal.rig import Rig
from rigcal.targets import Target
from rigcal_sim.boards import BoardConfig, CoverConfig
from rigcal_sim.cover import Coverage
from rigcal_sim.poses import board_pose, has_space, stream
from rigcal_sim.scenario import ScenarioConfig
from rigcal_sim.sight import sensor_poses, sensors_that_see, spots_in_view

MAX_DRAWS = 200
_CHOICES = 8
_BEARINGS_DEG = range(-180, 180, 15)
Draw = Callable[[np.random.Generator], Array]


@dataclass(frozen=True, eq=False)
class BoardPoses:
    """`T_w_t` (N, 4, 4), and the sensors that see each.

    `redrawn` poses were drawn again. `unseen` poses were seen by fewer than `min_sensors`
    sensors: drawn again, or kept if the scenario says so.
    """

    T_w_t: Array
    seen_by: tuple[tuple[str, ...], ...]
    redrawn: int
    unseen: int


def sample_board_poses(
    rig: Rig,
    registry: Registry,
    target: Target,
    scenario: ScenarioConfig,
    seed: int,
    poses: int | None = None,
) -> BoardPoses:
    """Board poses all around, or covering the sensors' views; `poses` of them if given.

    A pose at which the board (with the person behind it) would not fit into the room, or that
    fewer than `min_sensors` sensors see, is drawn again, the latter unless the scenario says
    `redraw: false`. ConfigError after 200 draws in vain, and if too few sensors see any pose.
    """
    sampler = _Sampler(rig, registry, target, scenario, sensor_poses(rig, scenario))
    board = scenario.board
    count = board.count if poses is None else poses
    rngs = [stream(seed, exposure, "board pose") for exposure in range(count)]
    if isinstance(board, CoverConfig):
        drawn, seen_by = sampler.covering(board, rngs)
    else:
        drawn, seen_by = sampler.around(board, rngs)
    few = sum(len(seen) < scenario.min_sensors for seen in seen_by)
    if few == len(seen_by):
        raise ConfigError(
            f"scenario: at none of the board's poses do {scenario.min_sensors} sensors "
            "(min_sensors) see it: show it where they look (see `board`)"
        )
    unseen = few or sampler.unseen
    return BoardPoses(np.array(drawn).reshape(-1, 4, 4), tuple(seen_by), sampler.redrawn, unseen)


_Drawn = tuple[list[Array], list[tuple[str, ...]]]


@dataclass(eq=False)
class _Sampler:
    """Draws poses until they can be used, and counts those that cannot."""

    rig: Rig
    registry: Registry
    target: Target
    scenario: ScenarioConfig
    T_w_s: Mapping[str, Array]
    redrawn: int = 0
    unseen: int = 0

    def around(self, board: BoardConfig, rngs: list[np.random.Generator]) -> _Drawn:
        """Poses over all bearings and radii, as many at each as at the others."""
        cells = list(itertools.product(board.bearings_deg, board.radii_m))
        drawn, seen_by = [], []
        for exposure, rng in enumerate(rngs):
            bearing, radius = cells[exposure * len(cells) // len(rngs)]

            def draw(rng: np.random.Generator, b: float = bearing, r: float = radius) -> Array:
                rpy_deg = board.draw_rpy_deg(rng)
                return board_pose(b, r, rng.uniform(*board.heights_m), rpy_deg)

            place = f"at bearing {bearing:g} deg, radius {radius:g} m"
            advice = partial(self._advice, board, radius)
            T_w_t, spots = self._usable(draw, rng, place, advice)
            drawn.append(T_w_t)
            seen_by.append(tuple(spots))
        return drawn, seen_by

    def covering(self, board: CoverConfig, rngs: list[np.random.Generator]) -> _Drawn:
        """Poses of which each is the newest to the sensors' views among 8 draws."""
        coverage = Coverage(board, self.rig, self.registry, self.target, self.T_w_s)
        near, far = coverage.distances[[0, -1]]
        place = f"{near:.3g} to {far:.3g} m from a sensor"
        drawn, seen_by = [], []
        for rng in rngs:
            options = [
                self._usable(coverage.draw, rng, place, lambda: "change distance_m or min_sensors")
                for _ in range(_CHOICES)
            ]
            T_w_t, spots = max(options, key=lambda option: coverage.gain(option[1]))
            coverage.add(spots)
            drawn.append(T_w_t)
            seen_by.append(tuple(spots))
        return drawn, seen_by

    def _usable(
        self, draw: Draw, rng: np.random.Generator, place: str, advice: Callable[[], str]
    ) -> tuple[Array, dict[str, Array]]:
        """A pose, and where the sensors that see it do."""
        few = self.scenario.min_sensors
        for _ in range(MAX_DRAWS):
            T_w_t = draw(rng)
            if not (fits := has_space(self.target, T_w_t, self.scenario)):
                self.redrawn += 1
                continue
            spots = spots_in_view(self.rig, self.registry, self.target, T_w_t, self.T_w_s)
            if len(spots) >= few or not self.scenario.redraw:
                return T_w_t, spots
            self.redrawn += 1
            self.unseen += 1
        if not fits:
            reason = "it does not fit into the room: enlarge that or show the board nearer"
        else:
            found = f"only {', '.join(spots)} sees" if spots else "no sensor sees"
            reason = f"{found} it there, expected {few} sensors (min_sensors): {advice()}"
        raise ConfigError(
            f"scenario: board {place}: none of {MAX_DRAWS} poses can be used; {reason}"
        )

    def _advice(self, board: BoardConfig, radius: float) -> str:
        """Bearings at which enough sensors see an unrotated board at that radius."""
        height = float(np.mean(board.heights_m))
        good = [
            str(bearing)
            for bearing in _BEARINGS_DEG
            for T_w_t in [board_pose(bearing, radius, height, np.zeros(3))]
            for seen in [sensors_that_see(self.rig, self.registry, self.target, T_w_t, self.T_w_s)]
            if len(seen) >= self.scenario.min_sensors
        ]
        if not good:
            root = self.rig.root
            if self.rig.sensors[root].optical and not any(self.scenario.root_pose.rpy_deg):
                return (
                    f"the world's z axis is up, and root '{root}' looks along its own z axis, up "
                    "too: give `root_pose: {rpy_deg: [-90, 0, -90]}` if it looks ahead"
                )
            return "no bearing is good at this radius and height, take others"
        return f"take bearings_deg among {', '.join(good)}"
