"""What a detector answers is checked before anything rests on it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rigcal.errors import ObservationError
from rigcal.observation import Candidate, Detection, LineGeometry, PointGeometry
from rigcal.plugin.answers import check_detection, checked_fiducials
from rigcal.targets.checkerboard import CheckerboardConfig, build_checkerboard

POINT = PointGeometry(np.ones(3), np.eye(3), np.zeros(3))
GOOD = Candidate(POINT, {"range": np.array(1.0)})


def test_a_whole_answer_passes() -> None:
    line = LineGeometry(np.zeros(3), np.ones(3), np.eye(6), start_is_edge=True)
    check_detection(Detection((GOOD, Candidate(line, {}, 2.0))))
    check_detection(Detection((), "it is dark"))


@pytest.mark.parametrize(
    ("answer", "complaint"),
    [
        (None, "it answered nothing, expected a Detection"),
        (3, "it answered an int, expected a Detection"),
        ([GOOD], "it answered a list, expected a Detection"),
        (Detection(("here",)), "candidate 0: found a str, expected a Candidate"),  # type: ignore[arg-type]
        (replace(GOOD, geometry=np.eye(4)), "geometry is a ndarray, expected one of PoseGeometry"),
        (
            replace(GOOD, geometry=replace(POINT, position=np.ones(2))),
            r"PointGeometry.position has shape \(2,\), expected \(3,\)",
        ),
        (
            replace(GOOD, geometry=replace(POINT, covariance=np.full((3, 3), np.nan))),
            "PointGeometry.covariance holds a value that is not finite",
        ),
        (replace(GOOD, measurement={"range": np.inf}), "measurement 'range' holds a value that"),
        (replace(GOOD, measurement={"range": "far"}), "measurement 'range' is a str, expected num"),
        (replace(GOOD, measurement=[1.0]), "measurement is a list, expected arrays by name"),
        (replace(GOOD, score=np.nan), "its score holds a value that is not finite"),
    ],
)
def test_what_is_wrong_is_named(answer: Any, complaint: str) -> None:
    found = Detection((GOOD, answer)) if isinstance(answer, Candidate) else answer
    with pytest.raises(ObservationError, match=complaint):
        check_detection(found)


BOARD = build_checkerboard("board", CheckerboardConfig(columns=3, rows=2, square_size_m=0.1))


def test_fiducials_of_a_target_pass_as_arrays() -> None:
    index, uv = checked_fiducials(BOARD, ([5, 0], [[1, 2], [3, 4]]))
    assert (index.tolist(), uv.tolist()) == ([5, 0], [[1.0, 2.0], [3.0, 4.0]])
    assert checked_fiducials(BOARD, ([], np.zeros((0, 2))))[1].shape == (0, 2)


@pytest.mark.parametrize(
    ("found", "complaint"),
    [
        (None, r"`find` of target 'board' answered nothing, expected \(indices, pixels\)"),
        ((np.arange(2), np.zeros((3, 2))), r"shapes \(2,\) and \(3, 2\), expected"),
        (([6], [[1.0, 2.0]]), "answered indices 6 to 6, but the target has 6 points"),
        (([0], [[1.0, np.nan]]), "answered a pixel that is not finite"),
    ],
)
def test_nonsense_of_a_target_is_named(found: object, complaint: str) -> None:
    with pytest.raises(ObservationError, match=complaint):
        checked_fiducials(BOARD, found)
