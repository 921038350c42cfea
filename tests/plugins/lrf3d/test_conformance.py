"""The 3D laser with each of its scans under the kit that every sensor plugin is tested by."""

from __future__ import annotations

from typing import Any

from rigcal.testing import SensorConformance
from rigcal_lrf3d import LRF3D, Lrf3dConfig


def laser(scan: dict[str, Any], sigma_m: float) -> Lrf3dConfig:
    return Lrf3dConfig.model_validate(
        {"topic": "/points", "scan": scan, "range_max_m": 30.0, "sigma_m": sigma_m}
    )


class TestMultibeam(SensorConformance):
    sensor_type = LRF3D
    config = laser(
        {
            "pattern": "multibeam",
            "elevations_deg": list(range(-30, 31, 2)),
            "azimuth_step_deg": 0.5,
        },
        0.01,
    )
    # Clouds, in messages and in observations, are kept in single precision.
    feature_tolerance = 1e-6


class TestSpinning(SensorConformance):
    sensor_type = LRF3D
    config = laser(
        {"pattern": "spinning_lrf", "tilt_deg": 10.0, "offset_m": 0.05, "angle_step_deg": 2.5}, 0.01
    )
    # Its beams start off the origin: errors are distances from the plane, a part of the range's.
    raw_noise_is_configured = False


class TestRosette(SensorConformance):
    sensor_type = LRF3D
    config = laser({"pattern": "rosette", "fov_deg": 80.0, "points_per_frame": 8000}, 0.02)


class TestDepthCamera(SensorConformance):
    sensor_type = LRF3D
    config = laser(
        {"pattern": "depth_camera", "width_px": 120, "height_px": 90, "focal_px": 75.0}, 0.01
    )
