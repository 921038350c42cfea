"""The scenario file: where the board is shown, and what stands around it."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal_sim.objects import ObjectConfig

Triple = tuple[float, float, float]
Interval = tuple[float, float]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class BoardConfig(_Section):
    """Where and how the board is shown: `samples` random rotations at every (bearing, radius).

    Unrotated, the board stands upright and faces the world's z axis. Its rotation is uniform in
    +-max_roll_deg about its normal, +-max_pitch_deg about its horizontal axis (leaning), and
    +-max_yaw_deg about its vertical axis (turning). Source: MSG-Cal, section 4.4.1.
    """

    bearings_deg: tuple[float, ...] = Field(min_length=1, description="about the world's z axis")
    radii_m: tuple[float, ...] = Field(min_length=1, description="from the world's origin")
    samples: int = Field(default=1, ge=1, description="rotations per bearing and radius")
    max_roll_deg: float = Field(default=20.0, ge=0, le=180)
    max_pitch_deg: float = Field(default=30.0, ge=0, le=80)
    max_yaw_deg: float = Field(default=35.0, ge=0, le=80)
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


class RootPoseConfig(_Section):
    """The root sensor in the world, whose z axis points up."""

    translation_m: Triple = (0.0, 0.0, 0.0)
    rpy_deg: Triple = (0.0, 0.0, 0.0)

    @property
    def T_w_root(self) -> Array:
        """(4, 4)."""
        R = se3.rotation_from_rpy(np.radians(self.rpy_deg))
        return se3.transform(R, np.array(self.translation_m))


class RoomConfig(_Section):
    """Four walls, a floor and a ceiling."""

    size_m: Triple = Field(description="length along x, along y, and height")
    center_m: tuple[float, float] = (0.0, 0.0)

    @model_validator(mode="after")
    def _has_space(self) -> RoomConfig:
        if min(self.size_m) <= 0:
            raise ValueError(f"size_m is {list(self.size_m)}; all three must be above 0")
        return self


class StampsConfig(_Section):
    """Header stamps: one exposure per period, each sensor off by up to `jitter_s`."""

    start_s: float = Field(default=1_600_000_000.0, ge=0)
    period_s: float = Field(default=1.0, gt=0)
    jitter_s: float = Field(default=0.005, ge=0)

    @model_validator(mode="after")
    def _exposures_stay_apart(self) -> StampsConfig:
        if 4 * self.jitter_s > self.period_s:
            raise ValueError(
                f"jitter_s {self.jitter_s:g} mixes exposures {self.period_s:g} s apart; "
                f"keep it below a quarter of period_s"
            )
        return self


class ScenarioConfig(_Section):
    """What a scenario file holds. World: z up, origin where the board's bearings start."""

    version: Literal[1] = 1
    target: str | None = Field(default=None, description="the rig's target that is shown")
    board: BoardConfig
    root_pose: RootPoseConfig = RootPoseConfig()
    floor_m: float = Field(default=-1.0, description="height of the floor")
    room: RoomConfig | None = None
    person: bool = Field(default=False, description="somebody stands behind the board")
    objects: tuple[ObjectConfig, ...] = Field(default=(), description="what else stands around")
    min_sensors: int = Field(
        default=2, ge=1, description="exposures that fewer sensors see are drawn again"
    )
    stamps: StampsConfig = StampsConfig()
    defaults: dict[str, dict[str, Any]] = Field(
        default_factory=dict, description="effects on all sensors of a type, by its name"
    )
    sensors: dict[str, dict[str, Any]] = Field(
        default_factory=dict, description="effects on one sensor, before the defaults of its type"
    )

    @model_validator(mode="after")
    def _fits_into_the_room(self) -> ScenarioConfig:
        low, high = self.board.heights_m
        if low <= self.floor_m:
            raise ValueError(
                f"board.height_m {low:g} is not above floor_m {self.floor_m:g}; raise the board "
                "or lower the floor"
            )
        if self.room is not None and high >= self.floor_m + self.room.size_m[2]:
            raise ValueError(
                f"board.height_m {high:g} is above the ceiling at "
                f"{self.floor_m + self.room.size_m[2]:g}; make room.size_m[2] larger"
            )
        return self
