"""How a 3D laser's beams are laid out: the `scan` section of its entry in a rig file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator


class _Scan(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class SpinningScan(_Scan):
    """A 2D laser spun about the sensor's z axis (MSG-Cal dissertation, section 4.4.1, fig. 4.3).

    At rest the 2D laser's forward axis is the z axis and its scan plane the y-z plane. `tilt_deg`
    leans the forward axis, and with it the scan plane, from z towards x; `offset_m` moves the
    laser along x; then all turns about z, `scans_per_deg` scans in each degree of
    `scan_angle_deg`. The beams of one scan go from `angle_min_deg` to `angle_max_deg` about the
    laser's forward axis.
    """

    pattern: Literal["spinning_lrf"] = "spinning_lrf"
    tilt_deg: float = Field(default=0.0, gt=-90, lt=90, description="forward axis away from z")
    offset_m: float = Field(default=0.0, description="2D laser's distance from the axis")
    scans_per_deg: float = Field(default=1.0, gt=0, description="2D scans per degree of turn")
    scan_angle_deg: float = Field(default=360.0, gt=0, le=360, description="turn of one cloud")
    angle_min_deg: float = Field(default=-135.0, ge=-180, le=180, description="first beam")
    angle_max_deg: float = Field(default=135.0, ge=-180, le=180, description="last beam")
    angle_step_deg: float = Field(default=1.0, gt=0, description="between two beams of a scan")

    @model_validator(mode="after")
    def _has_beams(self) -> SpinningScan:
        low, high = self.angle_min_deg, self.angle_max_deg
        if low >= high:
            raise ValueError(
                f"angle_min_deg {low:g} is not below angle_max_deg {high:g}; exchange them"
            )
        if self.angle_step_deg > high - low:
            raise ValueError(
                f"angle_step_deg {self.angle_step_deg:g} leaves one beam in a scan of "
                f"{high - low:g} degrees; make it smaller"
            )
        if self.scan_angle_deg * self.scans_per_deg < 1:
            raise ValueError(
                f"scans_per_deg {self.scans_per_deg:g} over scan_angle_deg "
                f"{self.scan_angle_deg:g} gives no whole scan; make one of them larger"
            )
        return self


class MultibeamScan(_Scan):
    """Beams at fixed elevations, turned through 360 degrees about the sensor's z axis."""

    pattern: Literal["multibeam"] = "multibeam"
    elevations_deg: tuple[Annotated[float, Field(gt=-90, lt=90)], ...] = Field(
        description="of each beam above the x-y plane"
    )
    azimuth_step_deg: float = Field(default=0.2, gt=0, le=90, description="between two firings")

    @model_validator(mode="after")
    def _has_beams(self) -> MultibeamScan:
        if not self.elevations_deg:
            raise ValueError("elevations_deg is empty; list the elevation of every beam")
        return self


class RosetteScan(_Scan):
    """One beam, deflected by two turning Risley prisms: a pattern that does not repeat.

    Both prisms deflect by `fov_deg` / 4, so that the beam draws a rosette about the sensor's x
    axis. Each frame starts at random angles of the prisms. Defaults: about a Livox Mid-40.
    """

    pattern: Literal["rosette"] = "rosette"
    fov_deg: float = Field(default=38.4, gt=0, le=170, description="opening angle of the view")
    points_per_frame: int = Field(default=10_000, ge=1)
    point_rate_hz: float = Field(default=100_000.0, gt=0)
    rotation_hz: tuple[float, float] = Field(
        default=(121.57, -77.73), description="turns per second of the two prisms"
    )


class DepthScan(_Scan):
    """The pixels of a depth camera, a pinhole that looks along the sensor's x axis, z up.

    The principal point is the image's middle. The noise of triangulation is `sigma_per_m2`.
    """

    pattern: Literal["depth_camera"] = "depth_camera"
    width_px: int = Field(default=320, ge=1)
    height_px: int = Field(default=240, ge=1)
    focal_px: float = Field(default=290.0, gt=0)


Scan = Annotated[
    SpinningScan | MultibeamScan | RosetteScan | DepthScan, Field(discriminator="pattern")
]
