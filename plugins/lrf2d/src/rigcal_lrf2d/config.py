"""The section of a rig file that describes a 2D laser range finder."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from rigcal.plugin.contract import SensorConfig

Limits = tuple[float, float]


class Lrf2dConfig(SensorConfig, frozen=True):
    """A 2D laser range finder: it scans the plane z = 0 of its frame, anticlockwise about z.

    The angles are needed to simulate only; a recording carries its own. Range limits given here
    hold beside those of the recording. `sigma_angle_deg` is the noise of each beam's direction.
    """

    type: Literal["lrf2d"] = "lrf2d"
    angle_min_deg: float | None = Field(default=None, ge=-360, le=360, description="first beam")
    angle_max_deg: float | None = Field(default=None, ge=-360, le=360, description="last beam")
    angle_step_deg: float | None = Field(default=None, gt=0, description="between two beams")
    range_min_m: float | None = Field(default=None, ge=0, description="nearest range reported")
    range_max_m: float | None = Field(default=None, gt=0, description="farthest range reported")
    sigma_m: float = Field(default=0.01, gt=0, description="noise of a range")
    sigma_angle_deg: float = Field(default=0.0, ge=0, description="noise of a beam's angle")
    filter: dict[str, Annotated[float | Limits, Field(union_mode="left_to_right")]] = Field(
        default_factory=dict,
        description="part of a cloud that is the scan: {field: value} or {field: [low, high]}",
    )

    @model_validator(mode="after")
    def _limits_are_ordered(self) -> Lrf2dConfig:
        low, high = self.angle_min_deg, self.angle_max_deg
        if low is not None and high is not None and not 0 < high - low <= 360:
            raise ValueError(
                f"the scan goes from angle_min_deg {low:g} to angle_max_deg {high:g}, "
                "expected up to 360 degrees upwards"
            )
        near, far = self.range_min_m or 0.0, self.range_max_m
        if far is not None and near >= far:
            raise ValueError(f"range_min_m {near:g} is not below range_max_m {far:g}")
        for name, wanted in self.filter.items():
            if isinstance(wanted, tuple) and wanted[0] > wanted[1]:
                raise ValueError(f"filter: {name} goes from {wanted[0]:g} to {wanted[1]:g}")
        return self
