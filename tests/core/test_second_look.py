"""Which frames are searched again, and what of the answers counts."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from rigcal.calibration import Calibration, Rejection, SensorResult
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.observation import Candidate, Detection, Observation, PointGeometry
from rigcal.plugin import Registry, SensorConfig, SensorType, hookimpl
from rigcal.rig import parse_rig
from rigcal.second_look import found_again, look_again

BOARD = {"type": "checkerboard", "columns": 7, "rows": 5, "square_size_m": 0.1}
AHEAD = se3.transform(np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]]), np.array([2.0, 0.0, 0.0]))
BEHIND = se3.transform(np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]), np.array([-2.0, 0.0, 0.0]))
COVARIANCE = np.eye(3) * 1e-6


class NoteConfig(SensorConfig, frozen=True):
    """Reads what a second look is to find from a text: a place, or nothing."""

    type: Literal["note"] = "note"


def at(*place: float) -> Candidate:
    return Candidate(PointGeometry(np.array(place), COVARIANCE, np.zeros(3)), {})


def _decode(message: Any, config: Any) -> str:
    text: str = message.value.read_text()
    return text


def _detect(frame: str, config: Any, target: Any) -> Detection:
    return Detection((), "missed at first")


def _near(frame: str, config: Any, target: Any, T_s_t: Array) -> Detection:
    np.testing.assert_allclose(T_s_t, AHEAD)
    return Detection((at(*map(float, frame.split())),)) if frame else Detection((), "not there")


def _combine(candidates: Any, mean: Any, config: Any, target: Any) -> Candidate:
    if mean.geometry.position[1] > 0.4:
        raise ZeroDivisionError("too far left")
    return Candidate(mean.geometry, {})


class Notes:
    @hookimpl
    def rigcal_sensor_types(self) -> list[SensorType]:
        reads = NoteConfig, (".txt",), _decode, _detect
        return [
            SensorType("note", *reads, near=_near, combine=_combine, sees=lambda p, _: p[:, 0] > 0)
        ]


REGISTRY = Registry([Notes()])
RIG = parse_rig(
    {
        "version": 1,
        "root": "note",
        "targets": {"board": BOARD},
        "sensors": {"note": {"type": "note", "files": "*.txt"}},
    },
    REGISTRY,
)


def looked(
    folder: Path,
    texts: list[str],
    *candidates: Candidate,
    T_root_t: Array = AHEAD,
    rejected: tuple[Rejection, ...] = (),
) -> Observation:
    """One observation after a second look at its frames, which read so."""
    for i, text in enumerate(texts):
        (folder / f"frame{i}.txt").write_text(text)
    frames = tuple(range(len(texts)))
    before = Observation("note", "0001", 0, "frames", candidates, "missed at first", frames)
    found = Calibration(
        "note", {"note": SensorResult("note", np.eye(4))}, {"0001": T_root_t}, rejected
    )
    (after,) = look_again(RIG, REGISTRY, folder, [before], found, jobs=1)
    added = len(after.candidates) - len(candidates)
    assert found_again([before], [after]) == ({"note": 1} if added else {})
    assert added or after is before
    return after


def place(o: Observation) -> Array:
    (candidate,) = o.candidates
    assert isinstance(candidate.geometry, PointGeometry)
    return candidate.geometry.position


def test_what_most_frames_agree_on_is_found(tmp_path: Path) -> None:
    after = looked(tmp_path, ["2 0.1 0", "2 0.1 0", "2 0.9 0", ""])
    np.testing.assert_allclose(place(after), [2, 0.1, 0], atol=1e-9)
    assert after.reason == ""


@pytest.mark.parametrize(
    "texts",
    [["", "", ""], ["2 0.1 0", "2 0.9 0", "3 0 0"], ["2 0.1 0", "", ""], ["2 0.5 0", "2 0.5 0"]],
    ids=["none", "all differ", "one of three", "plugin fails to combine"],
)  # fmt: skip
def test_what_does_not_hold_leaves_all_as_it_was(tmp_path: Path, texts: list[str]) -> None:
    assert looked(tmp_path, texts).candidates == ()


def test_a_board_out_of_view_is_not_looked_for(tmp_path: Path) -> None:
    assert looked(tmp_path, ["2 0.1 0"], T_root_t=BEHIND).candidates == ()


def test_an_inlier_is_not_looked_at_again(tmp_path: Path) -> None:
    np.testing.assert_allclose(place(looked(tmp_path, ["2 0.1 0"], at(2, 0.9, 0))), [2, 0.9, 0])


def test_what_was_rejected_is_looked_at_again_and_found_once(tmp_path: Path) -> None:
    rejected = (Rejection("note", "0001", "frames", "off"),)
    again = looked(tmp_path, ["2 0.1 0"], at(2, 0.9, 0), rejected=rejected)
    assert len(again.candidates) == 2
    same = looked(tmp_path, ["2 0.9 0"], at(2, 0.9, 0), rejected=rejected)
    assert len(same.candidates) == 1
