"""Observations of single messages and of what others detected, and what cannot be used."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest

import rigcal
from rigcal.errors import ObservationError, RecordingError
from rigcal.observation import Candidate, Detection, PointGeometry
from rigcal.plugin import Registry, SensorConfig, SensorType, hookimpl
from rigcal.residual import residual_of


class SonarConfig(SensorConfig, frozen=True):
    type: Literal["sonar"] = "sonar"


def _decode(message: rigcal.Message, config: object) -> Any:
    if message.value == "damaged":
        raise RecordingError(f"{message.origin}: found 'damaged'")
    return np.array(message.value, np.float64)


def _detect(frame: Any, config: object, target: object) -> Detection:
    if not len(frame):
        return Detection((), "silence")
    candidate = Candidate(PointGeometry.at(frame, [0.0, 0.0, 0.0], 0.01), {"point": frame})
    return Detection((candidate,))


def _fit(measured: Mapping[str, Any], config: object, target: object) -> Any:
    if "nonsense" in measured:
        return None
    return _detect(np.asarray(measured["point"]), config, target)


SONAR = SensorType("sonar", SonarConfig, ("acme/Ping",), _decode, _detect, fit=_fit)


def _observer(kind: SensorType = SONAR) -> rigcal.Observer:
    class Plugin:
        @hookimpl
        def rigcal_sensor_types(self) -> list[SensorType]:
            return [kind]

    registry = Registry([Plugin()])
    board = {"type": "checkerboard", "columns": 4, "rows": 3, "square_size_m": 0.1}
    sensors = {"bow": {"type": "sonar"}, "stern": {"type": "sonar"}}
    content = {"version": 1, "root": "bow", "targets": {"board": board}, "sensors": sensors}
    return rigcal.Observer(rigcal.parse_rig(content, registry), registry)


def _message(value: object, kind: str = "acme/Ping") -> rigcal.Message:
    return rigcal.Message(kind, value, 7, None, "live #3")


def test_a_message_is_detected_in() -> None:
    seen = _observer().see("bow", "5", _message([1.0, 2.0, 3.0]))
    assert (seen.sensor, seen.exposure, seen.stamp_ns, seen.origin) == ("bow", "5", 7, "live #3")
    geometry = seen.candidates[0].geometry
    assert isinstance(geometry, PointGeometry)
    assert geometry.position.tolist() == [1.0, 2.0, 3.0]
    nothing = _observer().see("bow", "5", _message([]))
    assert (nothing.candidates, nothing.reason) == ((), "silence")


def test_a_detector_that_fails_loses_its_frame_and_is_named() -> None:
    seen = _observer().see("bow", "5", _message([1.0]))
    assert seen.candidates == ()
    assert "the detector of sensor type 'sonar' failed: position is" in seen.reason


def test_a_detector_cannot_end_the_program_but_its_user_can() -> None:
    def detect(frame: Any, config: object, target: object) -> Detection:
        raise SystemExit(9) if len(frame) else KeyboardInterrupt

    observer = _observer(replace(SONAR, detect=detect))
    assert "failed: SystemExit: 9" in observer.see("bow", "5", _message([1.0])).reason
    with pytest.raises(KeyboardInterrupt):
        observer.see("bow", "5", _message([]))


@pytest.mark.parametrize(
    ("message", "complaint"),
    [
        (_message("damaged"), "live #3: found 'damaged'"),
        (_message("x"), "live #3: the decoder of sensor type 'sonar' failed with ValueError"),
        (_message([], "acme/Pong"), "sensor 'bow': live #3 is a acme/Pong; .*reads acme/Ping"),
    ],
)
def test_a_message_that_cannot_be_read_is_an_error(message: rigcal.Message, complaint: str) -> None:
    with pytest.raises(RecordingError, match=complaint):
        _observer().see("bow", "5", message)


def test_measurements_of_others_are_taken() -> None:
    taken = _observer().take("stern", "5", point=[1.0, 2.0, 3.0], stamp_ns=9)
    assert (taken.sensor, taken.stamp_ns, taken.origin) == ("stern", 9, "by hand")
    assert not taken.candidates[0].by_hand  # it has measurements, and counts by them
    assert _observer().take("bow", "5", point=[]).reason == "silence"


@pytest.mark.parametrize(
    ("sensor", "measured", "complaint"),
    [
        ("bow", {"points": [1.0]}, r"'bow', exposure '5': .*cannot use points \(1,\): KeyError"),
        ("bow", {"nonsense": 1}, "'bow', exposure '5': it answered nothing, expected a Detection"),
        ("bwo", {"point": [1.0]}, r"no sensor 'bwo', did you mean 'bow'\? \(has: bow, stern\)"),
    ],
)
def test_measurements_that_do_not_fit_are_named(
    sensor: str, measured: dict[str, Any], complaint: str
) -> None:
    with pytest.raises(ObservationError, match=complaint):
        _observer().take(sensor, "5", **measured)


def test_a_type_without_fit_says_what_to_do() -> None:
    with pytest.raises(ObservationError, match=r"does not take measurements; .*Observation\.of"):
        _observer(replace(SONAR, fit=None)).take("bow", "5", point=[1.0, 2.0, 3.0])


def test_hand_made_geometry_counts_instead_of_the_types_own_residual() -> None:
    def residual(candidate: Candidate, config: object, target: object) -> Any:
        raise AssertionError(candidate.measurement["point"])

    kind = replace(SONAR, residual=residual)
    (candidate,) = rigcal.Observation.of(
        "bow", "5", PointGeometry.at([1, 2, 3], [0, 0, 0], 0.1)
    ).candidates
    target = _observer(kind).targets["board"]
    r, _ = residual_of(kind, candidate, SonarConfig(), target)(np.eye(4))
    np.testing.assert_allclose(r, [-10, -20, -30])
