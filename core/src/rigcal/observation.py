"""What a detector reports: geometry in the sensor's frame, and the measurements behind it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigcal.errors import ObservationError
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import fit_plane, tangent_basis


@dataclass(frozen=True, eq=False)
class PoseGeometry:
    """The target's pose: `T_s_t` (4, 4), covariance (6, 6) of a right perturbation [rad, m]."""

    T_s_t: Array
    covariance: Array

    @classmethod
    def of(cls, T_s_t: ArrayLike, sigma_rad: float, sigma_m: float) -> Self:
        """A pose (4, 4) with equal noise about all axes and equal noise along them.

        ObservationError if it is no pose (a transposed one would be a plausible wrong one), or
        without noise.
        """
        _check_sigmas(sigma_rad=sigma_rad, sigma_m=sigma_m)
        T = _rows(T_s_t, "T_s_t", 4, least=1)
        rigid = T.shape == (4, 4) and np.allclose(T[3], [0, 0, 0, 1])
        if not rigid or not np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-3):
            raise ObservationError(
                f"T_s_t of shape {T.shape} is no pose; expected [[R, t], [0, 0, 0, 1]] (4, 4), R a "
                "rotation and t in metres, that takes the target's coordinates to the sensor's"
            )
        return cls(T, np.diag([sigma_rad**2] * 3 + [sigma_m**2] * 3))


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

    @classmethod
    def through(cls, points: ArrayLike, sigma_m: float) -> Self:
        """The plane nearest to points (N, 3) on the target, whose noise across it is `sigma_m`.

        ObservationError if the points do not span a plane, or without noise.
        """
        _check_sigmas(sigma_m=sigma_m)
        p = _rows(points, "points", 3, least=3)
        n, d = fit_plane(p)
        center = p.mean(axis=0)
        # The distance of a point changes by (a x n) . (p - center) with the tilt, and by -offset.
        tilt = np.cross(tangent_basis(n).T, n)
        J = np.column_stack([(p - center) @ tilt.T, -np.ones(len(p))])
        return cls(n, d, center, sigma_m**2 * _inverse(J.T @ J, "points", "a plane"))


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

    @classmethod
    def through(cls, points: ArrayLike, sigma_m: float) -> Self:
        """The line nearest to points (N, 2) in the plane z = 0 of a 2D laser, with that noise.

        It starts at the first and ends at the last point along it. ObservationError if the points
        do not span a line, or without noise.
        """
        _check_sigmas(sigma_m=sigma_m)
        p = _rows(points, "points", 2, least=2)
        center = p.mean(axis=0)
        along = np.linalg.svd(p - center, full_matrices=False)[2][0]
        along = along if along @ (p[-1] - p[0]) >= 0 else -along
        across = np.array([-along[1], along[0]])
        s = (p - center) @ along
        J = np.column_stack([np.ones(len(p)), s])
        covariance = sigma_m**2 * _inverse(J.T @ J, "points", "a line")
        ends = np.array([s.min(), s.max()])
        # An end moves across the line by offset + turn s, and along it by the noise of one point.
        M = np.zeros((6, 2))
        M[[0, 1]], M[[3, 4]] = (np.outer(across, [1.0, end]) for end in ends)
        free = np.zeros((3, 3))
        free[:2, :2] = sigma_m**2 * np.outer(along, along)
        free[2, 2] = _Z_VARIANCE
        full = M @ covariance @ M.T + np.kron(np.eye(2), free)
        start, end = (np.append(center + end * along, 0.0) for end in ends)
        return cls(start, end, full)


@dataclass(frozen=True, eq=False)
class PointGeometry:
    """A known point of the target: `position` (3,) in the sensor's frame, covariance (3, 3),
    and the same point in the target's frame, `target_point` (3,).
    """

    position: Array
    covariance: Array
    target_point: Array

    @classmethod
    def at(cls, position: ArrayLike, target_point: ArrayLike, sigma_m: float) -> Self:
        """A point seen at `position` (3,) that is at `target_point` (3,), with equal noise."""
        _check_sigmas(sigma_m=sigma_m)
        seen, known = _vector(position, "position"), _vector(target_point, "target_point")
        return cls(seen, sigma_m**2 * np.eye(3), known)


Geometry = PoseGeometry | PlaneGeometry | LineGeometry | PointGeometry


@dataclass(frozen=True, eq=False)
class MeanGeometry:
    """The mean of the geometries of N frames in which the target stands still.

    `variance_ratio`: its variance over that of one frame. 1 / N where the frames' errors are
    independent, more where they have some in common, or where the target trembles. `scatter`: the
    frames' mean square deviation from it, in units of their covariances.
    """

    geometry: Geometry
    variance_ratio: float
    scatter: float


@dataclass(frozen=True, eq=False)
class Candidate:
    """One hypothesis of where the target is in one frame.

    `measurement` holds the raw inlier measurements under names that only the sensor's own residual
    knows (numpy arrays; numbers are 0-d arrays); the name `by_hand` is reserved. `score` ranks the
    candidates of one frame, the highest first; at most one of them is right.
    """

    geometry: Geometry
    measurement: Mapping[str, NDArray[np.generic]]
    score: float = 0.0

    @property
    def by_hand(self) -> bool:
        """Whether it has no raw measurements and counts by its geometry and covariance."""
        return "by_hand" in self.measurement

    @property
    def tells_turn(self) -> bool:
        """Whether it tells how the target is turned in its own plane, as a pose alone does."""
        return isinstance(self.geometry, PoseGeometry)


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
    """The candidates of one sensor in one exposure (none: `reason` says why).

    `frames` are the places in the sensor's stream of the frames that it was made of.
    """

    sensor: str
    exposure: str
    stamp_ns: int
    origin: str
    candidates: tuple[Candidate, ...]
    reason: str = ""
    frames: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.exposure, str):
            raise ObservationError(
                f"sensor '{self.sensor}', exposure {self.exposure!r}: found "
                f"{type(self.exposure).__name__}, expected the exposure's name as text"
            )

    @classmethod
    def of(
        cls, sensor: str, exposure: str, *geometries: Geometry, stamp_ns: int = 0, origin: str = ""
    ) -> Self:
        """What a sensor saw in an exposure, by hand; several geometries are alternatives.

        Such candidates have no raw measurements: they count by their geometry and covariance.
        ObservationError without any geometry, and for what is none.
        """
        where = f"sensor '{sensor}', exposure '{exposure}'"
        if not geometries:
            raise ObservationError(f"{where}: no geometry; leave the observation out")
        for g in geometries:
            if not isinstance(g, Geometry):
                raise ObservationError(
                    f"{where}: found {type(g).__name__}, expected a PoseGeometry, PlaneGeometry, "
                    "LineGeometry or PointGeometry"
                )
        marked = {"by_hand": np.array(True)}
        candidates = tuple(Candidate(g, marked, -float(i)) for i, g in enumerate(geometries))
        return cls(sensor, exposure, stamp_ns, origin or "by hand", candidates)


_Z_VARIANCE = 1e-12
"""A 2D laser says nothing of z; covariances must not be singular for that."""


def _rows(values: ArrayLike, name: str, columns: int, least: int) -> Array:
    """Values as a finite (N, columns) array of at least so many rows."""
    array = np.asarray(values, np.float64)
    if array.ndim != 2 or array.shape[1] != columns or len(array) < least:
        raise ObservationError(
            f"{name} has shape {array.shape}, expected (N, {columns}) with N >= {least}"
        )
    if not np.isfinite(array).all():
        raise ObservationError(f"{name} holds a value that is not finite")
    return array


def _check_sigmas(**sigmas: float) -> None:
    for name, sigma in sigmas.items():
        if not (np.isfinite(sigma) and sigma > 0):
            raise ObservationError(f"{name} is {sigma}, expected a finite number above 0")


def _vector(values: ArrayLike, name: str) -> Array:
    array = np.asarray(values, np.float64)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise ObservationError(f"{name} is {values!r}, expected three finite numbers")
    return array


def _inverse(information: Array, what: str, shape: str) -> Array:
    if np.linalg.cond(information) > 1e12:
        raise ObservationError(f"the {what} do not span {shape}: they lie too close together")
    result: Array = np.asarray(np.linalg.inv(information), np.float64)
    return result
