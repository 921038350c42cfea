"""The skeleton sensor under the kit of `rigcal.testing`, and its files."""

import numpy as np
import pytest
from rigcal_skeleton import SKELETON, SkeletonConfig

from rigcal.plugin import Message, RecordingError
from rigcal.testing import SensorConformance

CONFIG = SkeletonConfig(topic="/front/points", reflector_m=(0.53, 0.1, 0.0))


class TestSkeleton(SensorConformance):
    sensor_type = SKELETON
    config = CONFIG


def _message(folder, text):
    path = folder / "0001.csv"
    path.write_text(text)
    return Message(".csv", path, 0, "1", path.name)


def test_a_file_holds_a_point_per_line(tmp_path):
    frame = SKELETON.decode(_message(tmp_path, "1.0,2.0,3.0\n4,5,6\nnan,0,0\n"), CONFIG)
    np.testing.assert_array_equal(frame, [[1, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize(
    ("text", "found"), [("1,2,3\n1.0,2.0\n", "line 2: found 2 numbers, "), ("here\n", "")]
)
def test_a_file_of_something_else_is_refused(tmp_path, text, found):
    with pytest.raises(RecordingError, match=rf"0001\.csv: {found}expected x,y,z"):
        SKELETON.decode(_message(tmp_path, text), CONFIG)
