"""What the sensor would measure in a scene: for `rigcal simulate`, and for the tests."""

import numpy as np
from numpy.typing import NDArray

import rigcal.plugin as rp
from rigcal.geometry import se3
from rigcal_skeleton.config import SkeletonConfig


def sees(points: rp.Array, config: SkeletonConfig) -> NDArray[np.bool_]:
    """(N,) which points (N, 3) in the sensor's frame are in its view."""
    ranges = np.linalg.norm(points, axis=1)
    in_cone = points[:, 0] >= np.cos(np.radians(config.fov_deg / 2)) * ranges
    return in_cone & (ranges <= config.range_max_m)


def simulate(
    T_w_s: rp.Array,
    scene: rp.Scene,
    config: SkeletonConfig,
    rng: np.random.Generator,
    effects: rp.Effects,
) -> rp.Array:
    """The reflector with noise, (1, 3); (0, 3) if the sensor does not see it.

    All randomness comes from `rng`: the same seed gives the same frame.
    """
    if scene.T_w_t is None:
        return np.zeros((0, 3))
    T_s_t = se3.inverse(T_w_s) @ scene.T_w_t
    point = se3.apply(T_s_t, np.array([config.reflector_m]))
    faces_it = se3.inverse(T_s_t)[2, 3] > 0
    if not faces_it or not sees(point, config)[0]:
        return np.zeros((0, 3))
    return point + rng.normal(0.0, config.sigma_m, (1, 3))
