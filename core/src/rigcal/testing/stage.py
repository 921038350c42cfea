"""What the checks stand on: a sensor, a board in its view, frames and candidates of it."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.selection import misfit
from rigcal.observation import Candidate
from rigcal.plugin.contract import Effects, Frame, Residual, SensorConfig, SensorType
from rigcal.recording.message import Message
from rigcal.residual import residual_of
from rigcal.scene import Scene
from rigcal.targets import BUILTIN_TARGETS, Target
from rigcal.testing.capability import report_what_is_not_offered

TOLERANCES = {"m": 1e-4, "px": 0.02}
_MOST_DRAWS = 2000


@cache
def default_board() -> Target:
    """4 x 3 AprilTags on a board of 1.2 m x 0.9 m."""
    (kind,) = (t for t in BUILTIN_TARGETS if t.name == "apriltag_grid")
    size: dict[str, Any] = {"width_m": 1.2, "height_m": 0.9, "tag_size_m": 0.2, "tag_gap_m": 0.05}
    return kind.build("board", kind.config.model_validate({"columns": 4, "rows": 3, **size}))


class Stage:
    """The few things that a plugin's author supplies, and what follows from them."""

    sensor_type: ClassVar[SensorType]
    config: ClassVar[Any]
    distances_m: ClassVar[tuple[float, float]] = (1.5, 2.6)
    """How far away the board is shown."""
    noise_free_effects: ClassVar[Effects | None] = None
    """Effects without noise, for types whose usual ones have some."""
    tolerance: ClassVar[float | None] = None
    """Rms error of a noise-free frame through the detector, in the type's unit; default: 1e-4 m,
    0.02 px."""
    feature_tolerance: ClassVar[float] = 1e-9
    """Rms error of what `observe` reports without noise, in the type's unit."""
    raw_noise_is_configured: ClassVar[bool] = True
    """False where the configured noise is that of features (corners), not of the raw data (pixels);
    then it is only an upper bound."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if hasattr(cls, "sensor_type"):
            report_what_is_not_offered(cls)

    folder: Path
    """A folder for the files that `message` may write; a new one for every check."""

    @pytest.fixture(autouse=True)
    def _own_folder(self, tmp_path: Path) -> None:
        self.folder = tmp_path

    @property
    def optical(self) -> bool:
        """Whether the sensor looks along z (x right, y down) instead of x (z up): as its config
        says of its frame.
        """
        return bool(self.config.optical)

    @property
    def target(self) -> Target:
        """The board; override it for a sensor that needs another one."""
        return default_board()

    def poses(self, rng: np.random.Generator, count: int) -> Array:
        """(count, 4, 4) poses `T_s_t` at which the whole board is in view, facing the sensor.

        The default draws them about the direction that the sensor looks along, turned by up to 29
        degrees about each axis, and keeps those that `sees` accepts. Override it for other fields
        of view.
        """
        found: list[Array] = []
        for _ in range(_MOST_DRAWS):
            T_s_t = self._draw_pose(rng)
            if self.in_view(T_s_t).all():
                found.append(T_s_t)
            if len(found) == count:
                return np.stack(found)
        raise AssertionError(
            f"of {_MOST_DRAWS} boards before the sensor only {len(found)} are wholly in view: "
            "override `poses` or `distances_m` in the test class, or set `optical` in the config "
            "class of a sensor that looks along z"
        )

    def message(self, T_s_t: Array, config: Any, rng: np.random.Generator) -> Message:
        """A message with the board at `T_s_t`; override it if the type does not simulate.

        It may write a file into `self.folder`; noise as `config` says.
        """
        kind = self.sensor_type
        assert kind.encode is not None
        assert kind.message_type is not None
        frame = self.simulate(T_s_t, config, rng)
        value = kind.encode(frame, config, 1_000_000_000, "sensor")
        return Message(kind.message_type, value, 1_000_000_000, None, "conformance kit")

    @classmethod
    def offers(cls) -> dict[str, bool]:
        """Optional capabilities by name, and whether the sensor type (or the test class) has them.

        frames: data with a known board, simulated or from an overridden `message`; candidates:
        observed, or detected in frames.
        """
        parts = ["residual", "errors", "measured_at", "fit", "observe", "simulate", "encode"]
        parts += ["sees", "view", "project", "combine", "near"]
        found = {part: getattr(cls.sensor_type, part, None) is not None for part in parts}
        found["refinable"], found["bends"] = bool(cls.sensor_type.refinable), cls.sensor_type.bends
        found["extra_messages"] = cls.sensor_type.extra_messages is not None
        found["frames"] = found["simulate"] or cls.message is not Stage.message
        found["messages"] = cls.message is not Stage.message or (
            found["simulate"] and found["encode"]
        )
        found["candidates"] = found["observe"] or found["frames"]
        return found

    @property
    def noise_free_config(self) -> SensorConfig:
        """The config with noise too small to matter: each `sigma_...` is made 1e-9 of itself.

        Override it for noise that has other names.
        """
        sigmas = {n: v * 1e-9 for n, v in self.config if n.startswith("sigma_") and v}
        result: SensorConfig = self.config.model_copy(update=sigmas)
        return result

    @property
    def raw_sigma(self) -> float | None:
        """Standard deviation of the raw errors: the config's `sigma_UNIT`, if it has one.

        Override it (None: not known) where the noise is not one number, but grows with range, say.
        """
        sigma: float | None = getattr(self.config, f"sigma_{self.sensor_type.unit}", None)
        return sigma

    def in_view(self, T_s_t: Array) -> np.ndarray:
        """Which points of a grid over the board the type says to see; all if it does not say."""
        steps = np.linspace(-0.5, 0.5, 9)
        grid = np.stack(np.meshgrid(steps, steps, [0.0]), axis=-1).reshape(-1, 3)
        p_s = se3.apply(T_s_t, grid * [*self.target.size, 0.0])
        sees = self.sensor_type.sees
        return np.ones(len(p_s), bool) if sees is None else sees(p_s, self.config)

    def simulate(
        self,
        T_s_t: Array | None,
        config: Any,
        rng: np.random.Generator,
        T_w_s: Array | None = None,
        effects: Effects | None = None,
    ) -> Frame:
        """A frame of the board at `T_s_t` (None: no board) and nothing else."""
        assert self.sensor_type.simulate is not None
        T_w_s = np.eye(4) if T_w_s is None else T_w_s
        scene = Scene(self.target, None if T_s_t is None else T_w_s @ T_s_t)
        effects = effects or self.sensor_type.effects()
        return self.sensor_type.simulate(T_w_s, scene, config, rng, effects)

    def frame(self, T_s_t: Array, rng: np.random.Generator, *, noise: bool = True) -> Frame:
        """A frame of the board at `T_s_t`, simulated or decoded from the author's message."""
        config = self.config if noise else self.noise_free_config
        if self.sensor_type.simulate is not None:
            effects = None if noise else self.noise_free_effects
            return self.simulate(T_s_t, config, rng, effects=effects)
        return self.sensor_type.decode(self.message(T_s_t, config, rng), self.config)

    def detected(self, frame: Frame) -> Candidate:
        """The best candidate in a frame that shows the board."""
        found = self.sensor_type.detect(frame, self.config, self.target)
        assert found.candidates, f"the board is in view, but not detected: {found.reason}"
        return found.candidates[0]

    def candidate(self, T_s_t: Array, rng: np.random.Generator, *, noise: bool = True) -> Candidate:
        """What the sensor reports of the board at `T_s_t`, observed if it can be, else detected."""
        if self.sensor_type.observe is None:
            return self.detected(self.frame(T_s_t, rng, noise=noise))
        config = self.config if noise else self.noise_free_config
        found = self.sensor_type.observe(T_s_t, config, self.target, rng)
        assert found is not None, f"the board is in view at\n{T_s_t}\nbut `observe` returned None"
        return found

    def residual(
        self,
        candidate: Candidate,
        refine: tuple[str, ...] = (),
        target: Target | None = None,
    ) -> Residual:
        """The type's own residual, or the default one of the geometry."""
        config = self.config.model_copy(update={"refine": refine}) if refine else self.config
        return residual_of(self.sensor_type, candidate, config, target or self.target)

    def errors(self, candidate: Candidate, T_s_t: Array) -> Array:
        """(N,) or (N, 2) errors of the raw measurements in the type's unit, or of the geometry."""
        if self.sensor_type.errors is None:
            return np.array([misfit(candidate.geometry, T_s_t, self.target)])
        return self.sensor_type.errors(candidate, self.config, self.target, T_s_t)

    @property
    def forward(self) -> Array:
        """(3, 3) columns forward, left, up, in the sensor's frame."""
        axes = np.eye(3)
        result: Array = np.column_stack([axes[2], -axes[0], -axes[1]]) if self.optical else axes
        return result

    def facing(self, distance_m: float) -> Array:
        """`T_s_t` of an upright board straight ahead."""
        ahead, left, up = self.forward.T
        return se3.transform(np.column_stack([-left, up, -ahead]), distance_m * ahead)

    def _draw_pose(self, rng: np.random.Generator) -> Array:
        distance = rng.uniform(*self.distances_m)
        bearing, height = rng.uniform(-0.4, 0.4), rng.uniform(-0.2, 0.2)
        ahead, left, up = self.forward.T
        T_s_t = self.facing(distance)
        T_s_t[:3, 3] = distance * (np.cos(bearing) * ahead + np.sin(bearing) * left) + height * up
        # The board turns to the sensor, then leans, turns and rolls at random.
        T_s_t[:3, :3] = se3.exp_so3(bearing * up) @ T_s_t[:3, :3]
        T_s_t[:3, :3] @= se3.exp_so3(rng.uniform(-0.5, 0.5, 3))
        return T_s_t
