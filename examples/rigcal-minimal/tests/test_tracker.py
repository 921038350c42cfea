"""The tracker under the kit of `rigcal.testing`: it has no simulator, so the test writes files."""

import numpy as np
from rigcal_tracker import TRACKER, TrackerConfig

from rigcal.geometry import se3
from rigcal.plugin import Message
from rigcal.testing import SensorConformance


class TestTracker(SensorConformance):
    sensor_type = TRACKER
    config = TrackerConfig(files="*.csv", prism_m=(0.5, 0.4, 0.03))

    def message(self, T_s_t, config, rng):
        point = se3.apply(T_s_t, np.array(config.prism_m)) + rng.normal(0.0, config.sigma_m, 3)
        path = self.folder / "0001.csv"
        path.write_text(",".join(map(str, point)))
        return Message(".csv", path, 0, "1", path.name)
