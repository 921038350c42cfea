"""What a detector reports: geometry in the sensor's frame, and the measurements behind it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rigcal.errors import ObservationError
from rigcal.geometry.se3 import Array


@dataclass(frozen=True, eq=False)
class PoseGeometry:
    """The target's pose: `T_s_t` (4, 4), covariance (6, 6) of a right perturbation [rad, m]."""

    T_s_t: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class PlaneGeometry:
    """The target's plane `n . p + d = 0`, the unit normal pointing to the sensor's side (d > 0).

    `center` (3,) is the centroid of the measurements, on the plane. `covariance` (3, 3) is over
    [tilt about the two columns of `tangent_basis(normal)` (rad), offset along n at `center` (m)]:
    a tilt a turns the normal to `n + a x n`. `boundary` (K, 3) is the measured outline on the
    plane, K = 0 when it was not seen.
    """

    normal: Array
    d: float
    center: Array
    covariance: Array
    boundary: Array = field(default_factory=lambda: np.zeros((0, 3)))


@dataclass(frozen=True, eq=False)
class LineGeometry:
    """A segment on the target: end points (3,) each, `covariance` (6, 6) over [start, end] (m).

    `start_is_edge`, `end_is_edge`: whether the segment ends there because the target does (and not
    because something hides the rest).
    """

    start: Array
    end: Array
    covariance: Array
    start_is_edge: bool = False
    end_is_edge: bool = False


@dataclass(frozen=True, eq=False)
class PointGeometry:
    """A known point of the target: `position` (3,) in the sensor's frame, covariance (3, 3),
    and the same point in the target's frame, `target_point` (3,).
    """

    position: Array
    covariance: Array
    target_point: Array


Geometry = PoseGeometry | PlaneGeometry | LineGeometry | PointGeometry


@dataclass(frozen=True, eq=False)
class Candidate:
    """One hypothesis of where the target is in one frame.

    `measurement` holds the raw inlier measurements under names that only the sensor's own residual
    knows (numpy arrays; numbers are 0-d arrays). `score` ranks the candidates of one frame, the
    highest first; at most one of them is right.
    """

    geometry: Geometry
    measurement: Mapping[str, NDArray[np.generic]]
    score: float = 0.0


@dataclass(frozen=True, eq=False)
class Detection:
    """What a detector made of one frame: candidates, best first; if none, the reason in words."""

    candidates: tuple[Candidate, ...]
    reason: str = ""

    def __post_init__(self) -> None:
        if not self.candidates and not self.reason:
            raise ObservationError("a detection without candidates must say why in `reason`")


@dataclass(frozen=True, eq=False)
class Observation:
    """The candidates of one sensor in one exposure (none: `reason` says why)."""

    sensor: str
    exposure: str
    stamp_ns: int
    origin: str
    candidates: tuple[Candidate, ...]
    reason: str = ""
