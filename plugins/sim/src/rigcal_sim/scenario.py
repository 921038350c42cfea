"""The scenario file: where the board is shown, and what stands around it."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal_sim.boards import Board, BoardConfig
from rigcal_sim.objects import ObjectConfig
from rigcal_sim.section import Section, Triple
from rigcal_sim.timing import OneFrameConfig, Recording, StampsConfig


class RootPoseConfig(Section):
    """The root sensor in the world, whose z axis points up."""

    translation_m: Triple = (0.0, 0.0, 0.0)
    rpy_deg: Triple = (0.0, 0.0, 0.0)

    @property
    def T_w_root(self) -> Array:
        """(4, 4)."""
        R = se3.rotation_from_rpy(np.radians(self.rpy_deg))
        return se3.transform(R, np.array(self.translation_m))


class RoomConfig(Section):
    """Four walls, a floor and a ceiling."""

    size_m: Triple = Field(description="length along x, along y, and height")
    center_m: tuple[float, float] = (0.0, 0.0)

    @model_validator(mode="after")
    def _has_space(self) -> RoomConfig:
        if min(self.size_m) <= 0:
            raise ValueError(f"size_m is {list(self.size_m)}; all three must be above 0")
        return self


class ScenarioConfig(Section):
    """What a scenario file holds. World: z up, origin where the board's bearings start."""

    version: Literal[1] = 1
    target: str | None = Field(default=None, description="the rig's target that is shown")
    board: Board = Field(description="how the poses of the board are sampled")
    root_pose: RootPoseConfig = RootPoseConfig()
    floor_m: float = Field(default=-1.0, description="height of the floor")
    room: RoomConfig | None = None
    person: bool = Field(default=False, description="somebody stands behind the board")
    objects: tuple[ObjectConfig, ...] = Field(default=(), description="what else stands around")
    min_sensors: int = Field(
        default=2, ge=1, description="poses that fewer sensors see are drawn again"
    )
    redraw: bool = Field(default=True, description="false: poses that too few see are kept")
    recording: Recording = Field(
        default=OneFrameConfig(mode="one_frame"), description="one frame per pose, or continuous"
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
        if not isinstance(self.board, BoardConfig):
            return self
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
