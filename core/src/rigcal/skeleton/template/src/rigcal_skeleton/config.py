"""What rig.yaml says of one skeleton sensor."""

from typing import Literal

from pydantic import Field

import rigcal.plugin as rp


class SkeletonConfig(rp.SensorConfig, frozen=True):
    """Frame: x forward, y left, z up. `topic`, `files`, `pose` and more are in the base class."""

    type: Literal["skeleton"] = "skeleton"
    reflector_m: tuple[float, float, float] = Field(description="in the target's frame")
    sigma_m: float = Field(default=0.02, gt=0, description="noise along each axis, 1 sigma")
    fov_deg: float = Field(default=120.0, gt=0, le=360, description="opening of its cone of view")
    range_max_m: float = Field(default=20.0, gt=0)
