"""Which frames make an exposure: what the recording shows, or what the rig says."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from rigcal import Registry, detect, parse_rig
from rigcal.errors import RecordingError
from rigcal.exposures import association_of
from rigcal.geometry import se3
from rigcal.observation import Candidate, Detection, PoseGeometry
from rigcal.plugin import Message, SensorConfig, SensorType, hookimpl

HOLD_S, WAY_S, PLACES = 2.0, 1.0, 5
SENSORS = ("bow", "stern")
RATES_HZ = {"bow": 10.0, "stern": 7.0}


class GaugeConfig(SensorConfig, frozen=True):
    type: Literal["gauge"] = "gauge"


def _decode(message: Message, config: Any) -> Any:
    return np.loadtxt(message.value)


def _detect(frame: Any, config: Any, target: Any) -> Detection:
    """A file holds the target's place, or that it is out of sight."""
    if np.isnan(frame).any():
        return Detection((), "out of sight")
    T_s_t = se3.transform(np.diag([1.0, -1.0, -1.0]), frame)
    return Detection((Candidate(PoseGeometry(T_s_t, 1e-6 * np.eye(6)), {}),))


class Plugin:
    @hookimpl
    def rigcal_sensor_types(self) -> list[SensorType]:
        return [SensorType("gauge", GaugeConfig, (".txt",), _decode, _detect)]


REGISTRY = Registry([Plugin()])


def rig(**fields: Any) -> Any:
    board = {"type": "checkerboard", "columns": 7, "rows": 5, "square_size_m": 0.1}
    sensors = {s: {"type": "gauge", "files": f"{s}/*.txt"} for s in SENSORS}
    document = {"version": 1, "root": "bow", "targets": {"board": board}, "sensors": sensors}
    return parse_rig(document | fields, REGISTRY)


def place(time_s: float) -> np.ndarray:
    """Held still for 2 s, then a metre in one."""
    k, rest = divmod(time_s, HOLD_S + WAY_S)
    return np.array([k + max(rest - HOLD_S, 0.0) / WAY_S, 0.0, 2.0])


def write(folder: Path, times_s: dict[str, Any], name: Any) -> Path:
    for sensor, times in times_s.items():
        (folder / sensor).mkdir()
        for i, t in enumerate(times):
            np.savetxt(folder / sensor / f"{name(i, t)}.txt", place(t))
    return folder


def stamp(i: int, time_s: float) -> str:
    return f"{1_600_000_000_000_000_000 + round(time_s * 1e9)}"


@pytest.fixture
def continuous(tmp_path: Path) -> Path:
    end = PLACES * (HOLD_S + WAY_S) - WAY_S
    return write(tmp_path, {s: np.arange(0.02, end, 1 / r) for s, r in RATES_HZ.items()}, stamp)


@pytest.fixture
def one_of_each(tmp_path: Path) -> dict[str, Any]:
    middle = HOLD_S / 2 + (HOLD_S + WAY_S) * np.arange(PLACES)
    return {"bow": middle, "stern": middle + 0.01}


def exposures(observations: Any) -> dict[str, set[str]]:
    found: dict[str, set[str]] = {}
    for o in observations:
        if o.candidates:
            found.setdefault(o.exposure, set()).add(o.sensor)
    return found


@pytest.mark.parametrize("said", [{}, {"association": "still"}])
def test_a_board_held_again_and_again_makes_exposures(continuous: Path, said: Any) -> None:
    observations = detect(rig(**said), REGISTRY, continuous, jobs=1)
    assert exposures(observations) == {f"{k:04d}": set(SENSORS) for k in range(PLACES)}
    assert association_of(rig().association, observations) == "still"
    for o in observations:
        if o.candidates:
            x = o.candidates[0].geometry.T_s_t[0, 3]
            assert x == pytest.approx(int(o.exposure), abs=1e-3)
            assert 7 <= len(o.frames) <= 10


def test_what_shows_nothing_at_the_first_look_is_not_looked_at_again(
    continuous: Path,
) -> None:
    for file in (continuous / "stern").iterdir():
        if np.loadtxt(file)[0] >= PLACES - 1:
            np.savetxt(file, np.full(3, np.nan))
    observations = detect(rig(), REGISTRY, continuous, jobs=1)
    frames = {(o.sensor, o.exposure): len(o.frames) for o in observations}
    seen, unseen = frames["bow", "0004"], frames["stern", "0004"]
    assert unseen <= 3 * HOLD_S < seen
    (reason,) = {o.reason for o in observations if (o.sensor, o.exposure) == ("stern", "0004")}
    assert reason == "out of sight"


def test_a_rig_that_says_nearest_or_same_index_uses_frames_in_motion(continuous: Path) -> None:
    near = detect(rig(association="nearest", tolerance_s=0.001), REGISTRY, continuous, jobs=1)
    both = [k for k, seen in exposures(near).items() if seen == set(SENSORS)]
    assert len(both) > 2 * PLACES
    assert all(len(o.frames) == 1 for o in near)
    together = detect(rig(association="nearest", tolerance_s=0.06), REGISTRY, continuous, jobs=1)
    lost = [o for o in together if not o.candidates]
    assert {o.reason for o in lost} == {
        "another frame of this sensor is nearer to the middle of the exposure"
    }
    assert {o.exposure for o in lost} == {f"stamp {o.stamp_ns}" for o in lost}
    indexed = detect(rig(association="same_index"), REGISTRY, continuous, jobs=1)
    assert exposures(indexed)["0050"] == set(SENSORS)


def test_one_frame_of_each_place_is_recognised(tmp_path: Path, one_of_each: Any) -> None:
    recording = write(tmp_path, one_of_each, stamp)
    observations = detect(rig(), REGISTRY, recording, jobs=1)
    assert association_of(None, observations) == "nearest"
    assert exposures(observations) == {f"{k:04d}": set(SENSORS) for k in range(PLACES)}


def test_files_that_carry_no_stamps_belong_together_by_name(
    tmp_path: Path, one_of_each: Any
) -> None:
    recording = write(tmp_path, one_of_each, lambda i, _: f"pose{i}")
    observations = detect(rig(), REGISTRY, recording, jobs=1)
    assert association_of(None, observations) == "file names"
    assert len(exposures(observations)) == PLACES
    with pytest.raises(RecordingError, match=r"sensor 'bow': its files carry no stamps"):
        detect(rig(association="still"), REGISTRY, recording, jobs=1)


def test_an_exposure_lasts_as_long_as_the_rig_says_or_is_none(tmp_path: Path) -> None:
    times = np.arange(0.02, 3 * (HOLD_S + WAY_S), 0.1)
    recording = write(tmp_path, dict.fromkeys(SENSORS, times), stamp)
    with pytest.raises(RecordingError, match="nowhere held still for 4 s"):
        detect(rig(association="still", hold_s=4.0), REGISTRY, recording, jobs=1)
