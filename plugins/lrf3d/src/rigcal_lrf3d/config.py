"""The section of a rig file that describes a 3D laser."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from rigcal.plugin.contract import SensorConfig

Limits = tuple[float, float]


class SpinningScan(BaseModel):
    """A 2D laser spun about the sensor's z axis (MSG-Cal dissertation, section 4.4.1, fig. 4.3).

    At rest the 2D laser's forward axis is the z axis and its scan plane the y-z plane. `tilt_deg`
    leans the forward axis, and with it the scan plane, from z towards x; `offset_m` moves the
    laser along x; then all turns about z, `scans_per_deg` scans in each degree of
    `scan_angle_deg`. The beams of one scan go from `angle_min_deg` to `angle_max_deg` about the
    laser's forward axis.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    pattern: Literal["spinning_lrf"] = "spinning_lrf"
    tilt_deg: float = Field(default=0.0, gt=-90, lt=90, description="forward axis away from z")
    offset_m: float = Field(default=0.0, description="2D laser's distance from the axis")
    scans_per_deg: float = Field(default=1.0, gt=0, description="2D scans per degree of turn")
    scan_angle_deg: float = Field(default=360.0, gt=0, le=360, description="turn of one cloud")
    angle_min_deg: float = Field(default=-135.0, ge=-180, le=180, description="first beam")
    angle_max_deg: float = Field(default=135.0, ge=-180, le=180, description="last beam")
    angle_step_deg: float = Field(default=1.0, gt=0, description="between two beams of a scan")

    @model_validator(mode="after")
    def _angles_are_ordered(self) -> SpinningScan:
        if self.angle_min_deg >= self.angle_max_deg:
            raise ValueError(
                f"angle_min_deg {self.angle_min_deg:g} is not below angle_max_deg "
                f"{self.angle_max_deg:g}"
            )
        return self


class MultibeamScan(BaseModel):
    """Beams at fixed elevations, turned through 360 degrees about the sensor's z axis."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    pattern: Literal["multibeam"] = "multibeam"
    elevations_deg: tuple[Annotated[float, Field(gt=-90, lt=90)], ...] = Field(
        min_length=1, description="of each beam above the x-y plane"
    )
    azimuth_step_deg: float = Field(default=0.2, gt=0, le=90, description="between two firings")


Scan = Annotated[SpinningScan | MultibeamScan, Field(discriminator="pattern")]


class Lrf3dConfig(SensorConfig, frozen=True):
    """A 3D laser: anything that gives clouds of points, in any order.

    `scan` is needed to simulate only. `beam_origin` says where the beams start: `sensor`, at the
    origin of the sensor's frame, so that errors are along the beams; `unknown`, so that they are
    orthogonal to the target's plane. Without it: `sensor` for multibeam and for a spinning laser
    without offset, else `unknown`. `sigma_angle_deg` is the noise of each beam's direction.
    """

    type: Literal["lrf3d"] = "lrf3d"
    scan: Scan | None = Field(default=None, description="how it scans; needed to simulate")
    sigma_m: float = Field(default=0.01, gt=0, description="noise of a range")
    sigma_angle_deg: float = Field(default=0.0, ge=0, description="noise of a beam's direction")
    range_min_m: float | None = Field(default=None, ge=0, description="nearest range used")
    range_max_m: float | None = Field(default=None, gt=0, description="farthest range used")
    filter: dict[str, Annotated[float | Limits, Field(union_mode="left_to_right")]] = Field(
        default_factory=dict,
        description="part of the cloud that is used: {field: value} or {field: [low, high]}",
    )
    beam_origin: Literal["sensor", "unknown"] | None = Field(
        default=None, description="where the beams start"
    )

    @model_validator(mode="after")
    def _limits_are_ordered(self) -> Lrf3dConfig:
        near, far = self.range_min_m or 0.0, self.range_max_m
        if far is not None and near >= far:
            raise ValueError(f"range_min_m {near:g} is not below range_max_m {far:g}")
        return self

    @property
    def beams_start_at_sensor(self) -> bool:
        """Whether every beam starts at the origin of the sensor's frame."""
        if self.beam_origin is not None:
            return self.beam_origin == "sensor"
        if isinstance(self.scan, SpinningScan):
            return self.scan.offset_m == 0
        return isinstance(self.scan, MultibeamScan)
