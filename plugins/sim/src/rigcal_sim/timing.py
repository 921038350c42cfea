"""The sections of a scenario that say when the sensors look: `stamps` and `recording`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from rigcal.plugin import Effects
from rigcal_sim.section import Section


class StampsConfig(Section):
    """Header stamps: where they start, and how far off each sensor's clock is.

    In a recording with one frame per pose, exposure k is k + 1 periods after the start.
    """

    start_s: float = Field(default=1_600_000_000.0, ge=0)
    period_s: float = Field(default=1.0, gt=0, description="between exposures of one frame each")
    jitter_s: float = Field(default=0.005, ge=0, description="a stamp is off by up to")

    @model_validator(mode="after")
    def _exposures_stay_apart(self) -> StampsConfig:
        if 4 * self.jitter_s > self.period_s:
            raise ValueError(
                f"jitter_s {self.jitter_s:g} mixes exposures {self.period_s:g} s apart; "
                f"keep it below a quarter of period_s"
            )
        return self

    def jitter_of(self, effects: Effects) -> float:
        """The jitter of a sensor (s): its own, if it has one."""
        return self.jitter_s if effects.jitter_s is None else effects.jitter_s


class OneFrameConfig(Section):
    """Every sensor takes one frame of every pose, all at the same time."""

    mode: Literal["one_frame"]


class ContinuousConfig(Section):
    """The board is carried from pose to pose and held still at each; sensors run at their rates.

    A frame shows the board where it is at the frame's time; motion within a frame is not
    simulated.
    """

    mode: Literal["continuous"]
    hold_s: float = Field(default=2.5, gt=0, description="how long the board is held at each pose")
    speed_m_s: float = Field(default=0.8, gt=0, description="highest speed while it is carried")
    turn_deg_s: float = Field(default=60.0, gt=0, description="highest turn rate meanwhile")
    tremor_mm: float = Field(default=0.0, ge=0, description="hand tremor per axis, 1 sigma")
    tremor_deg: float = Field(default=0.0, ge=0, description="the same of the board's rotation")


Recording = Annotated[OneFrameConfig | ContinuousConfig, Field(discriminator="mode")]
