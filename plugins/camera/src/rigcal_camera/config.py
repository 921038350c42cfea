"""What a camera needs in rig.yaml."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field, model_validator

from rigcal.plugin import SensorConfig

_COUNTS = {"pinhole": (0, 4, 5, 8, 12, 14), "fisheye": (0, 4)}


class CameraConfig(SensorConfig, frozen=True):
    """A camera with known intrinsics; frame: z forward, x right, y down, origin at its centre."""

    optical: ClassVar[bool] = True

    type: Literal["camera"] = "camera"
    width_px: int = Field(gt=0, description="width of the image")
    height_px: int = Field(gt=0, description="height of the image")
    model: Literal["pinhole", "fisheye"] = Field(
        default="pinhole", description="pinhole with OpenCV distortion, or OpenCV's fisheye"
    )
    focal_px: tuple[float, float] = Field(description="fx, fy")
    principal_px: tuple[float, float] = Field(
        description="cx, cy; (0, 0) is the centre of the top-left pixel"
    )
    distortion: tuple[float, ...] = Field(
        default=(),
        description="OpenCV order: 0, 4, 5, 8, 12 or 14 numbers (pinhole), 4 (fisheye)",
    )
    sigma_px: float = Field(default=0.2, gt=0, description="corner noise per axis, 1 sigma")
    min_corners: int = Field(default=6, ge=4, description="fewest corners that make a pose")

    @model_validator(mode="after")
    def _intrinsics_fit(self) -> CameraConfig:
        counts = _COUNTS[self.model]
        if len(self.distortion) not in counts:
            expected = ", ".join(map(str, counts))
            raise ValueError(
                f"distortion has {len(self.distortion)} numbers; "
                f"model {self.model} takes {expected} of them, in OpenCV's order"
            )
        if min(self.focal_px) <= 0:
            raise ValueError(f"focal_px is {list(self.focal_px)}; both must be above 0")
        return self
