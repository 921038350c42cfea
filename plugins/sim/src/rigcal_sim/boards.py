"""The `board` section of a scenario: how the poses of the board are sampled."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from rigcal.geometry.se3 import Array
from rigcal.targets import Target
from rigcal_sim.section import Interval, Section

_FAR_DIAGONALS = 3.0


class RotationConfig(Section):
    """Rotations of a board that would else stand upright and face the viewer.

    Uniform in +-max_roll_deg about its normal, +-max_pitch_deg about its horizontal axis
    (leaning), and +-max_yaw_deg about its vertical axis (turning).
    """

    max_roll_deg: float = Field(default=20.0, ge=0, le=180)
    max_pitch_deg: float = Field(default=30.0, ge=0, le=80)
    max_yaw_deg: float = Field(default=35.0, ge=0, le=80)

    def draw_rpy_deg(self, rng: np.random.Generator) -> Array:
        """Roll, pitch, yaw (3,)."""
        limits = np.array([self.max_roll_deg, self.max_pitch_deg, self.max_yaw_deg])
        return rng.uniform(-limits, limits)


class BoardConfig(RotationConfig):
    """`samples` random rotations at every (bearing, radius): R(theta, r) of MSG-Cal, 4.4.1.

    Unrotated, the board faces the world's z axis.
    """

    mode: Literal["around"] = "around"
    bearings_deg: tuple[float, ...] = Field(min_length=1, description="about the world's z axis")
    radii_m: tuple[float, ...] = Field(min_length=1, description="from the world's origin")
    samples: int = Field(default=1, ge=1, description="rotations per bearing and radius")
    height_m: float | Interval = Field(
        default=0.0, description="height of the board's centre, or [lowest, highest]"
    )

    @model_validator(mode="after")
    def _can_be_sampled(self) -> BoardConfig:
        if min(self.radii_m) <= 0:
            raise ValueError(f"radii_m holds {min(self.radii_m):g}; all must be above 0")
        low, high = self.heights_m
        if low > high:
            raise ValueError(
                f"height_m goes from {low:g} to {high:g}; write the lower height first"
            )
        return self

    @property
    def heights_m(self) -> Interval:
        """Lowest and highest height of the board's centre."""
        if isinstance(self.height_m, tuple):
            return self.height_m
        return (self.height_m, self.height_m)

    @property
    def count(self) -> int:
        """Number of poses."""
        return len(self.bearings_deg) * len(self.radii_m) * self.samples


class CoverConfig(RotationConfig):
    """`poses` that cover the views of all sensors evenly: near and far, middle and borders.

    Unrotated, the board faces one of the sensors.
    """

    mode: Literal["cover"]
    poses: int = Field(default=40, ge=1, description="number of poses")
    distance_m: Interval | None = Field(
        default=None,
        description="nearest and farthest from a sensor; default: 1 to 3 diagonals of the board",
    )

    @model_validator(mode="after")
    def _distances_are_ordered(self) -> CoverConfig:
        near, far = self.distance_m or (1.0, 2.0)
        if not 0 < near < far:
            raise ValueError(
                f"distance_m goes from {near:g} to {far:g}; write the nearer one first, above 0"
            )
        return self

    @property
    def count(self) -> int:
        """Number of poses."""
        return self.poses

    def distances_m(self, target: Target) -> Interval:
        """Nearest and farthest from a sensor."""
        diagonal = float(np.linalg.norm(target.size))
        return self.distance_m or (diagonal, _FAR_DIAGONALS * diagonal)


def _mode(value: Any) -> Any:
    found = value.get("mode", "around") if isinstance(value, dict) else value
    return getattr(found, "mode", found)


Board = Annotated[
    Annotated[BoardConfig, Tag("around")] | Annotated[CoverConfig, Tag("cover")],
    Discriminator(_mode),
]
