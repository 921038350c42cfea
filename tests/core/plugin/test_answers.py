"""What a detector answers is checked before anything rests on it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rigcal.errors import ObservationError
from rigcal.observation import Candidate, Detection, LineGeometry, PointGeometry
from rigcal.plugin.answers import check_detection

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
