"""The frame that decoder, detector and simulator of this plugin share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry.se3 import Array
from rigcal_lrf2d.config import Lrf2dConfig


@dataclass(frozen=True, eq=False)
class Scan:
    """One revolution or sweep: `angles` (N,) rad from x towards y, ascending, and `ranges` (N,) m.

    A beam without return has range inf. A scan made from points has no such beams; gaps in its
    angles stand for them.
    """

    angles: Array
    ranges: Array

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(N,) which beams returned a range."""
        return np.isfinite(self.ranges)

    @property
    def step(self) -> float:
        """Angle between neighbouring beams, rad (the median; inf for fewer than two beams)."""
        steps = np.diff(self.angles)
        steps = steps[steps > 1e-6]
        return float(np.median(steps)) if len(steps) else float("inf")

    @property
    def is_full_circle(self) -> bool:
        """Whether the last beam is a neighbour of the first one."""
        return bool(self.angles[-1] - self.angles[0] > 2 * np.pi - 8 * self.step)

    def cut_at_largest_jump(self) -> Scan:
        """The same scan, begun after its largest range jump if it is a full circle.

        Then no surface lies across its ends. Angles stay ascending and may exceed pi.
        """
        if len(self.angles) < 2 or not self.is_full_circle:
            return self
        capped = np.where(self.valid, self.ranges, 1e9)
        cut = int(np.argmax(np.abs(np.roll(capped, -1) - capped))) + 1
        angles = np.concatenate([self.angles[cut:], self.angles[:cut] + 2 * np.pi])
        # The two ends of a scan over exactly 360 degrees may overlap by a beam.
        return Scan(np.maximum.accumulate(angles), np.roll(self.ranges, -cut))


def scan_from_polar(
    angles: Array, ranges: Array, config: Lrf2dConfig, limits: tuple[float, float] = (0.0, np.inf)
) -> Scan:
    """A scan of (N,) angles (rad) and ranges (m) in any order.

    Ranges that are not finite, not positive or outside the limits (m, of the message and of the
    config) become inf: no return.
    """
    low, high = max(limits[0], config.limits[0]), min(limits[1], config.limits[1])
    with np.errstate(invalid="ignore"):
        good = np.isfinite(ranges) & (ranges > 0) & (ranges >= low) & (ranges <= high)
    order = np.argsort(angles, kind="stable")
    kept: Array = np.where(good, ranges, np.inf)
    return Scan(np.asarray(angles, np.float64)[order], kept[order])


def directions(angles: Array) -> Array:
    """(N, 3) unit directions of beams at (N,) angles (rad), in the plane z = 0."""
    return np.column_stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)])
