"""The section of a rig file that describes a 3D laser."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from rigcal.ranging import RangeConfig
from rigcal_lrf3d.scans import Scan, SpinningScan


class Lrf3dConfig(RangeConfig, frozen=True):
    """A 3D laser or depth camera: anything that gives clouds of points, in any order.

    `scan` is needed to simulate only. `beam_origin` says where the beams start: `sensor`, at the
    origin of the sensor's frame, so that errors are along the beams; `unknown`, so that they are
    orthogonal to the target's plane. Without it: `unknown` for a spinning laser with offset and
    where no scan is given, else `sensor`.
    """

    type: Literal["lrf3d"] = "lrf3d"
    scan: Scan | None = Field(default=None, description="how it scans; needed to simulate")
    beam_origin: Literal["sensor", "unknown"] | None = Field(
        default=None, description="where the beams start"
    )

    @property
    def beams_start_at_sensor(self) -> bool:
        """Whether every beam starts at the origin of the sensor's frame."""
        if self.beam_origin is not None:
            return self.beam_origin == "sensor"
        if isinstance(self.scan, SpinningScan):
            return self.scan.offset_m == 0
        return self.scan is not None
