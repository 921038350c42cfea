"""A simulated 2D laser range finder (MSG-Cal dissertation, section 4.4.1) and its messages."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.errors import ConfigError, RecordingError
from rigcal.geometry.se3 import Array
from rigcal.observation import Candidate
from rigcal.ranging import RangeEffects, measure
from rigcal.scene import Scene
from rigcal.targets.target import Target
from rigcal_lrf2d.config import Lrf2dConfig
from rigcal_lrf2d.detector import detect
from rigcal_lrf2d.scan import Scan, directions

MESSAGE_TYPE = "sensor_msgs/msg/LaserScan"
NO_EFFECTS = RangeEffects()


def beam_angles(config: Lrf2dConfig) -> Array:
    """(N,) nominal angles of all beams, rad; ConfigError if the config does not give them."""
    low, high, step = config.angle_min_deg, config.angle_max_deg, config.angle_step_deg
    missing = [
        name
        for name, value in (
            ("angle_min_deg", low),
            ("angle_max_deg", high),
            ("angle_step_deg", step),
        )
        if value is None
    ]
    if low is None or high is None or step is None:
        raise ConfigError(
            f"an lrf2d sensor lacks {', '.join(missing)}: to simulate it, or to plan for it, "
            "write for example angle_min_deg: -135.0, angle_max_deg: 135.0, angle_step_deg: 0.25"
        )
    count = int(np.floor((high - low) / step + 1e-6)) + 1
    result: Array = np.radians(low + step * np.arange(count))
    return result


def simulate(
    T_w_s: Array,
    scene: Scene,
    config: Lrf2dConfig,
    rng: np.random.Generator,
    effects: RangeEffects = NO_EFFECTS,
) -> Scan:
    """The scan of a sensor at `T_w_s` in `scene`.

    Each beam leaves at its nominal angle plus noise and reports the nominal angle and what
    `rigcal.ranging.measure` says. ConfigError if the config does not give the angles.
    """
    angles = beam_angles(config)
    turned = angles + effects.noise * config.noise.angle_rad * rng.standard_normal(len(angles))
    d_w = directions(turned) @ T_w_s[:3, :3].T
    return Scan(angles, measure(scene, T_w_s[:3, 3], d_w, config, effects, rng))


def sees(points: Array, config: Lrf2dConfig) -> NDArray[np.bool_]:
    """(N,) which points (N, 3) of the sensor's frame lie within its angles and ranges.

    The height above the scan plane does not matter; limits that the config leaves open are none.
    """
    ranges = np.linalg.norm(points, axis=1)
    low, high = config.limits
    good: NDArray[np.bool_] = (ranges >= low) & (ranges <= high)
    if config.angle_min_deg is None or config.angle_max_deg is None:
        return good
    first, last = np.radians([config.angle_min_deg, config.angle_max_deg])
    turn = np.mod(np.arctan2(points[:, 1], points[:, 0]) - first, 2 * np.pi)
    inside: NDArray[np.bool_] = good & (turn <= last - first)
    return inside


def observe(
    T_s_t: Array, config: Lrf2dConfig, target: Target, rng: np.random.Generator
) -> Candidate | None:
    """What the detector reports of a target in plain view, nothing else being there.

    None if fewer beams hit it than a line needs.
    """
    scan = simulate(np.eye(4), Scene(target, T_s_t), config, rng)
    candidates = detect(scan, config, target).candidates
    return candidates[0] if candidates else None


def encode(scan: Scan, config: Lrf2dConfig, stamp_ns: int, frame_id: str) -> Any:
    """The scan as a sensor_msgs/msg/LaserScan (float32; inf where nothing returned, REP 117).

    RecordingError if its beams are not evenly spaced: that message cannot hold such a scan.
    """
    from rigcal.recording import ros

    count = len(scan.angles)
    step = (scan.angles[-1] - scan.angles[0]) / (count - 1) if count > 1 else 0.0
    off = np.abs(scan.angles - (scan.angles[0] + step * np.arange(count)))
    if off.max() > 0.01 * step:
        raise RecordingError(
            f"beam {int(off.argmax())} of {count} lies {np.degrees(off.max()):.3g} deg off an even "
            f"spacing of {np.degrees(step):.3g} deg; a LaserScan holds evenly spaced beams only"
        )
    return ros.make(
        MESSAGE_TYPE,
        header=ros.header(stamp_ns, frame_id),
        angle_min=scan.angles[0],
        angle_max=scan.angles[-1],
        angle_increment=step,
        range_min=config.limits[0],
        range_max=config.limits[1],
        ranges=scan.ranges,
    )
