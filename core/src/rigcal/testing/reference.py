"""A sensor that measures the board's pose, to calibrate a sensor under test against."""

from __future__ import annotations

from typing import Any, Literal, NoReturn

import numpy as np

from rigcal.errors import RecordingError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.observation import Candidate, Detection, PoseGeometry
from rigcal.plugin import SensorConfig, SensorType
from rigcal.recording import Message
from rigcal.targets import Target

SIGMAS = np.array([1e-3, 1e-3, 1e-3, 2e-3, 2e-3, 2e-3])
"""Standard deviations of [rotation (rad), translation (m)]."""


class ReferenceConfig(SensorConfig, frozen=True):
    """The reference sensor."""

    type: Literal["kit-reference"] = "kit-reference"


def observe(T_s_t: Array, config: Any, target: Target, rng: np.random.Generator) -> Candidate:
    """The pose with noise, and its covariance."""
    noisy = T_s_t @ se3.exp(rng.normal(scale=SIGMAS))
    return Candidate(PoseGeometry(noisy, np.diag(SIGMAS**2)), {})


def _decode(message: Message, config: Any) -> NoReturn:
    raise RecordingError(f"{message.origin}: the reference sensor has no messages")


def _detect(frame: object, config: Any, target: Target) -> Detection:
    return Detection((), "the reference sensor observes only")


REFERENCE = SensorType(
    "kit-reference", ReferenceConfig, (".reference",), _decode, _detect, observe=observe
)
