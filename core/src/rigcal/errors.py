"""Every error that rigcal raises on purpose.

    RigcalError
    +-- InputError                 the user can mend it (exit status 2)
    |   +-- ConfigError            rig.yaml, a scenario or a calibration file
    |   +-- RecordingError         a bag, an MCAP or a folder of files
    |   +-- ObservationError       observations that are malformed, or their file
    |   +-- TargetSizeError        the target's dimensions contradict what the sensors measure
    |   +-- PluginError            a plugin that is broken, duplicate, mistyped or misspelt
    +-- Cancelled                  the caller's progress callback raised it, to stop the work
    +-- CalibrationError           the data do not give an answer (exit status 1)
        +-- NotConnectedError      sensors that share no usable exposures
        +-- NotDeterminedError     a pose that the data leave open
        +-- NotConvergedError      the optimiser found no minimum

A message says where, what was found, what was expected, and what to do.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


class RigcalError(Exception):
    """Base class; `exit_code` is what the command line returns."""

    exit_code = 1


class InputError(RigcalError):
    """Something in the input that the user can mend."""

    exit_code = 2


class ConfigError(InputError):
    """A rig, scenario or calibration file that cannot be used."""


class RecordingError(InputError):
    """A recording that cannot be read, or that lacks what the rig names."""


class ObservationError(InputError):
    """Observations that are malformed, or a file of them that cannot be read."""


class TargetSizeError(InputError):
    """The target's dimensions in the rig file contradict what the sensors measure."""


class PluginError(InputError):
    """A plugin that is broken, duplicate, mistyped or misspelt."""


class Cancelled(RigcalError):  # noqa: N818 (it is no fault)
    """For progress callbacks that want the work to stop: it ends at once and leaves nothing."""


class CalibrationError(RigcalError):
    """The data do not give an answer."""


class NotConnectedError(CalibrationError):
    """Some sensors share no usable exposures with the others.

    `groups` of sensors that hang together, and pairs that would join them (`joins`).
    """

    def __init__(
        self,
        message: str,
        groups: Sequence[Sequence[str]] = (),
        joins: Sequence[tuple[str, str]] = (),
    ) -> None:
        super().__init__(message)
        self.groups, self.joins = groups, joins


class NotDeterminedError(CalibrationError):
    """The data leave some direction of a sensor's pose, or a number to refine, open.

    `verdict` tells per axis (`rigcal.diagnosis.verdict.Verdict`); None where it is not of poses.
    """

    def __init__(self, message: str, verdict: Any = None) -> None:
        super().__init__(message)
        self.verdict = verdict


class NotConvergedError(CalibrationError):
    """The optimiser did not find a minimum."""
