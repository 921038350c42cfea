"""The 2D laser under the kit that every sensor plugin is tested by."""

from rigcal.testing import SensorConformance
from rigcal_lrf2d import LRF2D, Lrf2dConfig


class TestLrf2d(SensorConformance):
    sensor_type = LRF2D
    config = Lrf2dConfig(
        topic="/scan",
        angle_min_deg=-135.0,
        angle_max_deg=135.0,
        angle_step_deg=0.5,
        range_max_m=30.0,
        sigma_m=0.01,
    )
