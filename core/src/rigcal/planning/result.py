"""What `plan` returns: how well sensors are known or would be, and board poses to record next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rigcal.diagnosis.observability import WEAK
from rigcal.geometry.se3 import Array


@dataclass(frozen=True)
class Sigma:
    """Standard deviation of a sensor's place (m) and attitude (rad), infinite where open.

    Roots of the summed variances of the three axes.
    """

    translation_m: float
    rotation_rad: float

    @property
    def size(self) -> float:
        """The larger of the two, in units of what makes a result weak (20 mm, 0.5 deg)."""
        return max(self.translation_m / float(WEAK[3]), self.rotation_rad / float(WEAK[0]))


Sigmas = Mapping[str, Sigma]
"""By sensor."""


def worst(sigmas: Sigmas) -> str:
    """The sensor that is known least, the first of equals; "" where there is none."""
    return max(sigmas, key=lambda name: sigmas[name].size, default="")


@dataclass(frozen=True, eq=False)
class Proposal:
    """A board pose `T_root_t` (4, 4) of the target named, and the same in words.

    `seen_by` are the sensors that have the board in view there, `sigmas` what is known of all when
    this pose and those before it are recorded.
    """

    target: str
    T_root_t: Array
    seen_by: tuple[str, ...]
    words: str
    sigmas: Sigmas


@dataclass(frozen=True, eq=False)
class Plan:
    """What a rig's sensors will be known to, and what to record next.

    reference   the sensor as seen from which the others are known: the root, if it can be planned
                for
    T_root_s    pose (4, 4) of every sensor that the plan rests on
    predicted   by number of exposures: sigmas that so many board poses, spread over the sensors'
                views, lead to; empty where observations were given
    recorded    sigmas of what was recorded; None where no observations were given
    proposals   board poses that shrink the worst of them, one after the other
    boards      `T_root_t` (4, 4) and target of the boards that were recorded, or an example of
                those that the prediction is for
    up          (3,) unit vector in the root's frame
    unjoined    sensors that the observations do not join to the root
    unplanned   sensors for which no board pose is planned, with the reason
    """

    reference: str
    T_root_s: Mapping[str, Array]
    predicted: Mapping[int, Sigmas]
    recorded: Sigmas | None
    proposals: tuple[Proposal, ...]
    boards: tuple[tuple[str, Array], ...]
    up: Array
    unjoined: tuple[str, ...] = ()
    unplanned: Mapping[str, str] = field(default_factory=dict)

    @property
    def after(self) -> Sigmas | None:
        """Sigmas once all proposals are recorded."""
        return self.proposals[-1].sigmas if self.proposals else self.recorded
