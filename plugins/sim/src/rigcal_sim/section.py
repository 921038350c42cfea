"""What all sections of a scenario file have in common."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

Triple = tuple[float, float, float]
Interval = tuple[float, float]


class Section(BaseModel):
    """Unknown keys and numbers that are not finite are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
