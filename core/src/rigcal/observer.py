"""Observations one at a time: of live messages, and of what another program has detected."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np

from rigcal.errors import ObservationError, RecordingError, RigcalError
from rigcal.geometry.se3 import Array
from rigcal.observation import Detection, Observation
from rigcal.plugin.answers import check_detection
from rigcal.plugin.contract import SensorConfig, SensorType
from rigcal.plugin.registry import Registry
from rigcal.recording.message import Message
from rigcal.rig import Rig, build_targets
from rigcal.targets.target import Target
from rigcal.validation import nearest_of

_log = logging.getLogger(__name__)


class Observer:
    """Makes observations for the sensors of a rig. It keeps nothing of what it is given.

    ConfigError for targets that are no boards, PluginError for types that are not installed.
    """

    def __init__(self, rig: Rig, registry: Registry) -> None:
        self.targets = build_targets(rig, registry)
        """The rig's targets by name: where their points are, and how they are numbered."""
        self._rig = rig
        self._kinds = {name: registry.sensor_type(s.type) for name, s in rig.sensors.items()}

    def see(self, sensor: str, exposure: str, message: Message) -> Observation:
        """Detect the target in one message, of whatever origin.

        An observation without candidates says why. RecordingError if the sensor cannot read it.
        """
        kind, config, target = self._parts(sensor)
        check_type(sensor, kind, message)
        try:
            frame = kind.decode(message, config)
        except RigcalError:
            raise
        except (Exception, SystemExit) as error:
            raise RecordingError(decoder_failure(kind, message, error)) from error
        found = detect_in_frame(kind, config, target, frame)
        return _observation(sensor, exposure, message.stamp_ns, message.origin, found)

    def take(
        self, sensor: str, exposure: str, *, stamp_ns: int = 0, origin: str = "", **measured: Any
    ) -> Observation:
        """What another program found on the target: arrays under the names of the sensor type.

        A camera takes `index` (M,) into the target's points with `uv` (M, 2) pixels; lasers take
        the `points` (N, 3 or 2) that are on the board. ObservationError for anything else.
        """
        kind, config, target = self._parts(sensor)
        shapes = ", ".join(f"{name} {np.shape(value)}" for name, value in measured.items())
        where = f"sensor '{sensor}', exposure '{exposure}'"
        if kind.fit is None:
            raise ObservationError(
                f"{where}: sensor type '{kind.name}' does not take measurements; give what they "
                "say of the target, by `Observation.of`"
            )
        try:
            found = kind.fit(measured, config, target)
            check_detection(found)
        except RigcalError as error:
            raise ObservationError(f"{where}: {error}") from error
        except (Exception, SystemExit) as error:
            raise ObservationError(
                f"{where}: sensor type '{kind.name}' cannot use {shapes or 'nothing'}: "
                f"{type(error).__name__}: {error}"
            ) from error
        return _observation(sensor, exposure, stamp_ns, origin or "by hand", found)

    def _parts(self, sensor: str) -> tuple[SensorType, SensorConfig, Target]:
        if sensor not in self._kinds:
            raise ObservationError(f"no sensor '{sensor}'{nearest_of(sensor, list(self._kinds))}")
        target = self.targets[self._rig.target_of(sensor)]
        return self._kinds[sensor], self._rig.sensors[sensor], target


def check_type(sensor: str, kind: SensorType, message: Message) -> None:
    """RecordingError if a sensor does not read messages of this type."""
    if message.type not in kind.message_types:
        raise RecordingError(
            f"sensor '{sensor}': {message.origin} is a {message.type}; sensor type '{kind.name}' "
            f"reads {', '.join(kind.message_types)}: check the sensor's topic or files"
        )


def decoder_failure(kind: SensorType, message: Message, error: BaseException) -> str:
    """In words: a decoder raised what it should not."""
    return (
        f"{message.origin}: the decoder of sensor type '{kind.name}' failed with "
        f"{type(error).__name__}: {error}"
    )


def detect_in_frame(
    kind: SensorType,
    config: SensorConfig,
    target: Target,
    frame: object,
    T_s_t: Array | None = None,
) -> Detection:
    """The detector's answer; one that raises, or answers nonsense, loses its frame, not the run.

    With `T_s_t` (4, 4), where the target is about, a sensor type that offers `near` looks there.
    """
    try:
        if T_s_t is None or kind.near is None:
            found = kind.detect(frame, config, target)
        else:
            found = kind.near(frame, config, target, T_s_t)
        check_detection(found)
    except (Exception, SystemExit) as error:
        _log.debug("detector of sensor type '%s' raised", kind.name, exc_info=True)
        what = "" if isinstance(error, ObservationError) else f"{type(error).__name__}: "
        return Detection((), f"the detector of sensor type '{kind.name}' failed: {what}{error}")
    return found


def _observation(
    sensor: str, exposure: str, stamp_ns: int, origin: str, found: Detection
) -> Observation:
    return Observation(sensor, exposure, stamp_ns, origin, found.candidates, found.reason)
