"""Parts of the conformance kit by themselves: what is the same, and its reference sensor."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rigcal.plugin import Message, RecordingError
from rigcal.testing.reference import REFERENCE, ReferenceConfig
from rigcal.testing.same import assert_same


def test_the_reference_sensor_of_the_kit_reads_no_recordings() -> None:
    message = Message("none", None, 0, None, "bag, message 3")
    with pytest.raises(RecordingError, match="bag, message 3: the reference sensor has no"):
        REFERENCE.decode(message, ReferenceConfig())
    found = REFERENCE.detect(None, ReferenceConfig(), None)
    assert (found.candidates, found.reason) == ((), "the reference sensor observes only")


def test_frames_may_be_objects_of_any_class() -> None:
    def frame(**changes: Any) -> SimpleNamespace:
        return SimpleNamespace(**{"ranges": np.ones(3), "unit": "m", "_cache": object()} | changes)

    assert_same(frame(), frame())
    with pytest.raises(AssertionError, match=r"the frame\.unit: 'm' and 'mm'"):
        assert_same(frame(), frame(unit="mm"))
    with pytest.raises(AssertionError, match=r"the frame\.ranges"):
        assert_same(frame(), frame(ranges=np.ones(3) + 1e-9))
