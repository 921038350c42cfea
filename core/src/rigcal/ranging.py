"""What all sensors that measure ranges along beams share: noise, limits, simulated measurements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from rigcal.errors import RecordingError
from rigcal.geometry.se3 import Array
from rigcal.plugin.contract import Effects, SensorConfig
from rigcal.plugin.refinable import Parameters, Refinable
from rigcal.scene import Scene

Limits = tuple[float, float]

_TOLERABLE_BIAS_M = 0.01
_RING = 6
_RING_RADIUS = np.sqrt((_RING + 1) / (2 * _RING))
"""Rays on a ring and one in its middle, all of equal weight, spread like a disc of radius 1."""


@dataclass(frozen=True)
class RangeNoise:
    """Standard deviation of a range r, `constant_m + per_m r + per_m2 r^2`, and of a beam's angle.

    Constant and proportional parts are how data sheets give it; the quadratic part is that of
    triangulation (Khoshelham and Elberink, "Accuracy and resolution of Kinect depth data", 2012).
    """

    constant_m: float
    per_m: float = 0.0
    per_m2: float = 0.0
    angle_rad: float = 0.0

    def of(self, ranges: ArrayLike) -> Array:
        """Standard deviations (m) of ranges (m), same shape."""
        r = np.asarray(ranges, np.float64)
        result: Array = self.constant_m + r * (self.per_m + r * self.per_m2)
        return result

    def on_plane(self, ranges: Array, cosine: Array) -> Array:
        """(...) standard deviations (m) of ranges to a plane, with what the angle noise adds.

        `cosine` is that of the incidence, `n . rho`. A beam turned by e meets the plane
        `r tan(incidence) e` farther.
        """
        if self.angle_rad == 0:
            return self.of(ranges)
        tangent = np.sqrt(np.maximum(1 - cosine**2, 0)) / np.abs(cosine)
        result: Array = np.hypot(self.of(ranges), ranges * tangent * self.angle_rad)
        return result


class RangeConfig(SensorConfig, frozen=True):
    """The noise and the limits of a sensor of ranges; sensor types add their own fields.

    The noise of a range r has standard deviation `sigma_m + sigma_per_m r + sigma_per_m2 r^2`.
    `range_bias_m` is taken off in residuals and views; a detector's first line or plane still has
    it.
    """

    range_min_m: float | None = Field(default=None, ge=0, description="nearest range used")
    range_max_m: float | None = Field(default=None, gt=0, description="farthest range used")
    sigma_m: float = Field(default=0.01, gt=0, description="noise of a range, constant part")
    sigma_per_m: float = Field(default=0.0, ge=0, description="noise of a range, part per metre")
    sigma_per_m2: float = Field(
        default=0.0, ge=0, description="noise of a range, part per square metre (depth cameras)"
    )
    range_bias_m: float = Field(
        default=0.0, description="by how much its ranges are too long; with refine, where it starts"
    )
    sigma_angle_deg: float = Field(default=0.0, ge=0, description="noise of a beam's direction")
    filter: dict[str, Annotated[float | Limits, Field(union_mode="left_to_right")]] = Field(
        default_factory=dict,
        description="part of a cloud that is used: {field: value} or {field: [low, high]}",
    )

    @model_validator(mode="after")
    def _limits_are_ordered(self) -> RangeConfig:
        low, high = self.limits
        if low >= high:
            raise ValueError(
                f"range_min_m {low:g} is not below range_max_m {high:g}; exchange them or leave "
                "one out"
            )
        for name, wanted in self.filter.items():
            if isinstance(wanted, tuple) and wanted[0] > wanted[1]:
                raise ValueError(
                    f"filter: {name} goes from {wanted[0]:g} to {wanted[1]:g}; write [low, high]"
                )
        return self

    @property
    def limits(self) -> Limits:
        """Nearest and farthest range (m); 0 and inf where the file does not say."""
        return self.range_min_m or 0.0, self.range_max_m or np.inf

    @property
    def noise(self) -> RangeNoise:
        """The noise of ranges and angles."""
        angle = float(np.radians(self.sigma_angle_deg))
        return RangeNoise(self.sigma_m, self.sigma_per_m, self.sigma_per_m2, angle)

    def kept(self, fields: Mapping[str, NDArray[Any]], origin: str) -> NDArray[np.bool_]:
        """(N,) which points, given by their fields (N,), `filter` keeps.

        RecordingError if it names a field that is not there, or keeps none of them.
        """
        keep = np.ones(len(next(iter(fields.values()))), dtype=bool)
        for name, wanted in self.filter.items():
            if name not in fields:
                raise RecordingError(
                    f"{origin}: filter names the field {name!r}, but the points have "
                    f"{', '.join(fields)}"
                )
            values = np.asarray(fields[name])
            low, high = wanted if isinstance(wanted, tuple) else (wanted, wanted)
            keep &= (values >= low) & (values <= high)
            if len(values) and not keep.any():
                raise RecordingError(
                    f"{origin}: filter {dict(self.filter)} keeps none of the {len(values)} points; "
                    f"{name} goes from {values.min():g} to {values.max():g}"
                )
        return keep


def _bias_parameters(config: RangeConfig) -> Parameters:
    return Parameters(
        names=("range_bias_m",),
        units=("m",),
        values=np.array([config.range_bias_m]),
        effect=np.array([[1 / _TOLERABLE_BIAS_M]]),
        tolerable=f"{1000 * _TOLERABLE_BIAS_M:g} mm",
        advice="a bias looks like a shift of the sensor where all boards stand in one direction: "
        "show the board on opposite sides, near and far, together with another sensor",
    )


def _with_bias(config: RangeConfig, values: Array) -> RangeConfig:
    return config.model_copy(update={"range_bias_m": float(values[0])})


RANGE_BIAS = Refinable(_bias_parameters, _with_bias)
"""The bias of all ranges of a sensor, as `refine: [range_bias]` asks for it."""


class RangeEffects(Effects, frozen=True):
    """What a scenario may say of a sensor of ranges beyond its noise; all is off by default."""

    noise: float = Field(default=1.0, ge=0, description="factor on the sensor's noise; 0: none")
    bias_m: float = Field(default=0.0, description="added to every range")
    quantisation_m: float = Field(default=0.0, ge=0, description="step that ranges are rounded to")
    dropout: float = Field(default=0.0, ge=0, le=1, description="share of returns that are lost")
    outliers: float = Field(
        default=0.0, ge=0, le=1, description="share of returns with a random range"
    )
    divergence_deg: float = Field(
        default=0.0,
        ge=0,
        lt=10,
        description="opening angle of a beam: at edges it reports a range in between",
    )


def turned(directions: Array, sigma_rad: float, rng: np.random.Generator) -> Array:
    """Unit directions (N, 3) turned by noise of `sigma_rad` in each of the two angles."""
    if sigma_rad == 0:
        return directions
    noise = rng.normal(0.0, sigma_rad, directions.shape)
    noise -= np.sum(noise * directions, axis=1)[:, None] * directions
    aimed = directions + noise
    result: Array = aimed / np.linalg.norm(aimed, axis=1, keepdims=True)
    return result


def measure(
    scene: Scene,
    p_w: Array,
    d_w: Array,
    config: RangeConfig,
    effects: RangeEffects,
    rng: np.random.Generator,
) -> Array:
    """(N,) ranges (m) that beams along d_w (N, 3) from p_w (3,) or (N, 3) report; inf for none.

    The first surface's range (MSG-Cal, eq. 4.10 to 4.12), then noise, bias, outliers and rounding;
    what lies outside the config's limits then, or is lost, is no return.
    """
    noise = effects.noise * rng.standard_normal(len(d_w))
    true = _footprint_ranges(scene, p_w, d_w, np.radians(effects.divergence_deg))
    returned = np.isfinite(true)
    ranges = np.where(returned, true, 0.0)
    ranges = ranges + noise * config.noise.of(ranges) + effects.bias_m + config.range_bias_m
    low, high = config.limits
    if effects.outliers > 0 and returned.any():
        wild = rng.random(len(ranges)) < effects.outliers
        farthest = high if np.isfinite(high) else float(true[returned].max())
        ranges = np.where(wild, rng.uniform(low, farthest, len(ranges)), ranges)
    if effects.quantisation_m > 0:
        ranges = np.round(ranges / effects.quantisation_m) * effects.quantisation_m
    if effects.dropout > 0:
        returned &= rng.random(len(ranges)) >= effects.dropout
    good = returned & (ranges > 0) & (ranges >= low) & (ranges <= high)
    return np.where(good, ranges, np.inf)


def _footprint_ranges(scene: Scene, p_w: Array, d_w: Array, divergence_rad: float) -> Array:
    """(N,) ranges of beams of an opening angle: the middle's, at edges the mean over the beam.

    A beam returns if at least half of it does.
    """
    ranges, hit = scene.cast(p_w, d_w)
    if divergence_rad == 0 or len(d_w) == 0:
        return ranges
    aimed = _ring(d_w, _RING_RADIUS * divergence_rad / 2)
    starts = p_w if p_w.ndim == 1 else np.tile(p_w, (_RING, 1))
    around, struck = scene.cast(starts, aimed.reshape(-1, 3))
    all_ranges = np.vstack([ranges, around.reshape(_RING, -1)])
    seen = np.isfinite(all_ranges)
    count = seen.sum(axis=0)
    mean = np.where(seen, all_ranges, 0.0).sum(axis=0) / np.maximum(count, 1)
    at_edge = np.any(struck.reshape(_RING, -1) != hit, axis=0)
    mixed = np.where(2 * count > _RING, mean, np.inf)
    return np.where(at_edge, mixed, ranges)


def _ring(d_w: Array, angle_rad: float) -> Array:
    """(_RING, N, 3) unit directions at an angle from each of (N, 3), evenly around it."""
    axis = np.eye(3)[np.argmin(np.abs(d_w), axis=1)]
    across = np.cross(d_w, axis)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    up = np.cross(d_w, across)
    turn = np.arange(_RING)[:, None, None] * (2 * np.pi / _RING)
    side = np.cos(turn) * across + np.sin(turn) * up
    result: Array = np.cos(angle_rad) * d_w + np.sin(angle_rad) * side
    return result
