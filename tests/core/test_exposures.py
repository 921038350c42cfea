"""Which frames are one exposure."""

from rigcal.exposures import FrameStamp, exposure_names

MS = 1_000_000


def frames(*spec):
    counts = {}
    result = []
    for sensor, stamp_ms, key in spec:
        counts[sensor] = counts.get(sensor, -1) + 1
        result.append(FrameStamp(sensor, stamp_ms * MS, key, counts[sensor]))
    return result


def test_stamps_within_the_tolerance_are_one_exposure():
    f = frames(("a", 0, None), ("b", 30, None), ("a", 1000, None), ("b", 990, None))
    assert exposure_names(f, "nearest", 0.05) == ["0000", "0000", "0001", "0001"]


def test_of_several_frames_of_a_sensor_the_middle_one_counts():
    f = frames(("a", 0, None), ("a", 20, None), ("a", 40, None), ("b", 21, None))
    assert exposure_names(f, "nearest", 0.05) == [None, "0000", None, "0000"]


def test_keys_of_files_are_exposures():
    f = frames(("a", 0, "17"), ("b", 0, "17"), ("b", 0, "3"))
    assert exposure_names(f, "nearest", 0.05) == ["17", "17", "3"]


def test_same_index_needs_no_common_clock():
    f = frames(("a", 0, None), ("a", 100, None), ("b", 7_000_000, None), ("b", 7_000_100, None))
    assert exposure_names(f, "same_index", 0.05) == ["0000", "0001", "0000", "0001"]


def test_stamps_of_this_century_keep_their_nanoseconds():
    now = 1_800_000_000_000
    f = frames(("a", now, None), ("b", now + 49, None), ("a", now + 100, None))
    assert exposure_names(f, "nearest", 0.05) == ["0000", "0000", "0001"]
