"""The 3D laser under the kit that every sensor plugin is tested by."""

from rigcal.testing import SensorConformance
from rigcal_lrf3d import LRF3D, Lrf3dConfig


class TestMultibeam(SensorConformance):
    sensor_type = LRF3D
    config = Lrf3dConfig.model_validate(
        {
            "topic": "/points",
            "scan": {
                "pattern": "multibeam",
                "elevations_deg": list(range(-30, 31, 2)),
                "azimuth_step_deg": 0.5,
            },
            "range_max_m": 30.0,
            "sigma_m": 0.01,
        }
    )
    # Clouds, in messages and in observations, are kept in single precision.
    feature_tolerance = 1e-6
