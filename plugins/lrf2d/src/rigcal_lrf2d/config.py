"""The section of a rig file that describes a 2D laser range finder."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from rigcal.ranging import RangeConfig


class Lrf2dConfig(RangeConfig, frozen=True):
    """A 2D laser range finder: it scans the plane z = 0 of its frame, anticlockwise about z.

    The angles are needed to simulate only; a recording carries its own. Range limits given here
    hold beside those of the recording. `filter` makes a scan of a cloud.
    """

    type: Literal["lrf2d"] = "lrf2d"
    angle_min_deg: float | None = Field(default=None, ge=-360, le=360, description="first beam")
    angle_max_deg: float | None = Field(default=None, ge=-360, le=360, description="last beam")
    angle_step_deg: float | None = Field(default=None, gt=0, description="between two beams")

    @model_validator(mode="after")
    def _has_beams(self) -> Lrf2dConfig:
        low, high, step = self.angle_min_deg, self.angle_max_deg, self.angle_step_deg
        if low is None or high is None:
            return self
        if not 0 < high - low <= 360:
            raise ValueError(
                f"the scan goes from angle_min_deg {low:g} to angle_max_deg {high:g}, "
                "expected angle_max_deg above angle_min_deg, by at most 360"
            )
        if step is not None and step > high - low:
            raise ValueError(
                f"angle_step_deg {step:g} leaves one beam in a scan of {high - low:g} degrees; "
                "make it smaller"
            )
        return self
