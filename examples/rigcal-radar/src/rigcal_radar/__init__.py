"""Automotive radar for rigcal: it measures a corner reflector at a known place of the board.

A radar returns range, azimuth and, if it can, elevation of whatever reflects. A trihedral corner
reflector on the board is a strong return among others; each return is a candidate, and the other
sensors tell which one is right. A frame is an array (N, 5) with the columns of `COLUMNS`.
"""

import csv
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from pydantic import Field

import rigcal.plugin as rp
from rigcal.geometry.se3 import Array, apply, inverse, rotation_from_rpy
from rigcal.recording import ros
from rigcal.residual import PointResidual

SCAN, RETURN = "radar_msgs/msg/RadarScan", "radar_msgs/msg/RadarReturn"
FIELDS = "range", "azimuth", "elevation", "doppler_velocity", "amplitude"
DEFINITIONS = {RETURN: "\n".join(f"float32 {name}" for name in FIELDS)}
DEFINITIONS[SCAN] = "std_msgs/Header header\nradar_msgs/RadarReturn[] returns"
COLUMNS = "range_m", "azimuth_rad", "elevation_rad", "doppler_velocity_m_s", "amplitude_db"
REFLECTOR_DB, CLUTTER_DB, FADING_DB, MOST_CANDIDATES, FAR_M = 40.0, 20.0, 3.0, 8, 1e6


class RadarConfig(rp.SensorConfig, frozen=True):
    """A radar: x forward, azimuth from x towards y, elevation from the x-y plane towards z."""

    type: Literal["radar"] = "radar"
    reflector_m: tuple[float, float, float] = Field(description="in the target's frame")
    sigma_range_m: float = Field(default=0.03, gt=0)
    sigma_azimuth_deg: float = Field(default=0.3, gt=0)
    sigma_elevation_deg: float | None = Field(default=0.5, gt=0, description="null: not measured")
    fov_deg: tuple[float, float] = Field(default=(120.0, 40.0), description="across and upright")
    range_max_m: float = Field(default=50.0, gt=0)

    def sigmas(self) -> Array:
        """(3,) of range, azimuth, elevation (m, rad); (2,) if elevation is not measured."""
        angles = [s for s in (self.sigma_azimuth_deg, self.sigma_elevation_deg) if s]
        return np.array([self.sigma_range_m, *np.radians(angles)])


def spherical(p: Array) -> Array:
    """Range, azimuth, elevation (..., 3) of points (..., 3)."""
    x, y, z = np.moveaxis(p, -1, 0)
    h = np.hypot(x, y)
    return np.stack([np.hypot(h, z), np.arctan2(y, x), np.arctan2(z, h)], axis=-1)


def axes(polar: Array) -> Array:
    """(..., 3, 3) unit vectors along which range, azimuth and elevation grow, as columns."""
    return rotation_from_rpy(polar[..., [0, 2, 1]] * [0, -1, 1])


def cartesian(polar: Array) -> Array:
    """Points (..., 3) of range, azimuth, elevation (..., 3)."""
    return polar[..., :1] * axes(polar)[..., 0]


def lengths(polar: Array) -> Array:
    """How far (3,) a point moves as range, azimuth (rad) and elevation (rad) grow by 1."""
    return np.array([1.0, polar[0] * np.cos(polar[2]), polar[0]])


def decode(message: rp.Message, config: RadarConfig) -> Array:
    """The returns in a RadarScan, or in a CSV file with `COLUMNS`; RecordingError for others."""
    try:
        if message.type == SCAN:
            rows = [[getattr(item, name) for name in FIELDS] for item in message.value.returns]
        else:
            table = csv.DictReader(message.value.read_text(encoding="utf-8").splitlines())
            rows = [[float(row[name]) for name in COLUMNS] for row in table]
    except (OSError, ValueError, TypeError, KeyError, csv.Error) as error:
        raise rp.RecordingError(f"{message.origin}: expected {COLUMNS}: {error!r}") from error
    frame = np.array(rows, np.float64).reshape(-1, 5)
    return frame[np.isfinite(frame).all(axis=1) & (frame[:, 0] > 0)]


def detect(frame: Array, config: RadarConfig, target: rp.Target) -> rp.Detection:
    """The strongest returns as candidates for the reflector."""
    found, unknown = [], np.radians(config.fov_deg[1]) / np.sqrt(12)
    for row in frame[np.argsort(-frame[:, 4], kind="stable")[:MOST_CANDIDATES]]:
        L = axes(row[:3]) * lengths(row[:3]) * np.append(config.sigmas(), unknown)[:3]
        geometry = rp.PointGeometry(cartesian(row[:3]), L @ L.T, np.array(config.reflector_m))
        found.append(rp.Candidate(geometry, {"polar": row[None, :3]}, float(row[4])))
    return rp.Detection(tuple(found), "" if found else "the radar returned nothing")


@dataclass(frozen=True, eq=False)
class RadarResidual:
    """Predicted minus measured range, azimuth and elevation of the reflector, over their sigmas."""

    measured: Array
    point: PointResidual
    sigmas: Array
    block: int
    dof: int

    def __call__(self, T_s_t: Array) -> tuple[Array, Array]:
        """R (m,) and J (m, 6), by the derivative of the reflector's place in the sensor's frame."""
        p_s, J = self.point(T_s_t)
        error = (polar := spherical(p_s)) - self.measured
        error[1:] = (error[1:] + np.pi) % (2 * np.pi) - np.pi
        J = axes(polar).T / lengths(polar)[:, None] @ J
        return error[: self.dof] / self.sigmas, J[: self.dof] / self.sigmas[:, None]


def residual(candidate: rp.Candidate, config: RadarConfig, target: rp.Target) -> RadarResidual:
    """The residual of one return."""
    measured, m = np.reshape(candidate.measurement["polar"], 3), len(config.sigmas())
    point = PointResidual(np.array(config.reflector_m), np.zeros(3), np.eye(3))
    return RadarResidual(measured, point, config.sigmas(), m, m)


def sees(points: Array, config: RadarConfig) -> Any:
    """(N,) which points (N, 3) are within the radar's angles and range."""
    limits = [config.range_max_m, *np.radians(config.fov_deg) / 2]
    return np.all(np.abs(spherical(points)) <= limits, axis=1)


def simulate(T_w_s: Array, scene: rp.Scene, config: RadarConfig, rng: Any, effects: Any) -> Array:
    """Returns of the reflector, if nothing hides it, and of surfaces: one for each 6 x 18 degrees.

    A trihedral answers what comes within 65 degrees of its axis, which is the board's normal.
    """
    angles = np.radians(np.arange(-87, 90, 6))
    rows = np.stack(np.meshgrid(0.0, angles, angles[::3], 0.0, CLUTTER_DB), axis=-1).reshape(-1, 5)
    if scene.T_w_t is not None:
        T_s_t = inverse(T_w_s) @ scene.T_w_t
        p_s = apply(T_s_t, np.array(config.reflector_m))
        if -p_s @ T_s_t[:3, 2] > np.cos(np.radians(65)) * np.linalg.norm(p_s):
            rows = np.vstack([rows, [*spherical(p_s), 0.0, REFLECTOR_DB]])
    rays = cartesian(rows[:, :3] * [0, 1, 1] + [1, 0, 0]) @ T_w_s[:3, :3].T
    ranges = np.minimum(replace(scene, T_w_t=None).cast(T_w_s[:3, 3], rays)[0], FAR_M)
    rows[:, 0] = np.where(rows[:, 0] == 0, ranges, rows[:, 0])
    rows = rows[(rows[:, 0] <= ranges) & sees(cartesian(rows[:, :3]), config)]
    rows[:, 4] -= 40 * np.log10(rows[:, 0])
    rows[:, 2] *= len(config.sigmas()) == 3
    return rows + rng.normal(size=rows.shape) * [*[*config.sigmas(), 0.0][:3], 0.0, FADING_DB]


def encode(frame: Array, config: RadarConfig, stamp_ns: int, frame_id: str) -> Any:
    """A radar_msgs/msg/RadarScan."""
    returns = [ros.make(RETURN, DEFINITIONS, **dict(zip(FIELDS, r, strict=True))) for r in frame]
    return ros.make(SCAN, DEFINITIONS, header=ros.header(stamp_ns, frame_id), returns=returns)


def view(message: rp.Message, config: RadarConfig) -> rp.FrameView:
    """The returns as points."""
    return rp.FrameView(points=cartesian(decode(message, config)[:, :3]))


RADAR = rp.SensorType("radar", RadarConfig, (SCAN, ".csv"), decode, detect, residual)
RADAR = replace(RADAR, simulate=simulate, encode=encode, message_type=SCAN, sees=sees, view=view)
RADAR = replace(RADAR, message_definitions=DEFINITIONS)


@rp.hookimpl
def rigcal_sensor_types() -> list[rp.SensorType]:
    """The radar."""
    return [RADAR]
