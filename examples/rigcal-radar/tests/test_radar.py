"""The radar under the kit of `rigcal.testing`, with and without elevation; its CSV files."""

import numpy as np
import pytest
from rigcal_radar import RADAR, RadarConfig, decode, detect

from rigcal.errors import RecordingError
from rigcal.plugin import Message
from rigcal.testing import SensorConformance
from rigcal.testing.residual_checks import ResidualChecks

CONFIG = RadarConfig(topic="/radar/scan", reflector_m=(0.53, 0.1, 0.02))


class TestRadar(SensorConformance):
    sensor_type = RADAR
    config = CONFIG


class TestRadarWithoutElevation(ResidualChecks):
    sensor_type = RADAR
    config = CONFIG.model_copy(update={"sigma_elevation_deg": None})
    # Its errors are those of a point, whose elevation it does not know.
    tolerance = 1.0


CSV = """range_m,azimuth_rad,elevation_rad,doppler_velocity_m_s,amplitude_db
2.0,0.5,0.1,0.0,12.0
3.0,-0.2,0.0,0.0,30.0
nan,0.0,0.0,0.0,50.0
"""


def test_a_table_of_returns_is_read_and_the_strongest_comes_first(tmp_path):
    path = tmp_path / "0001.csv"
    path.write_text(CSV)
    frame = decode(Message(".csv", path, 0, "1", path.name), CONFIG)
    assert frame.shape == (2, 5)
    best, second = detect(frame, CONFIG, None).candidates
    expected = [3.0 * np.cos(0.2), -3.0 * np.sin(0.2), 0.0]
    np.testing.assert_allclose(best.geometry.position, expected, atol=1e-12)
    assert (best.score, second.score) == (30.0, 12.0)


def test_a_table_of_something_else_is_refused_with_what_was_expected(tmp_path):
    path = tmp_path / "0001.csv"
    path.write_text("time,speed\n1,2\n")
    with pytest.raises(RecordingError, match=r"0001.csv: expected .*range_m"):
        decode(Message(".csv", path, 0, "1", path.name), CONFIG)
