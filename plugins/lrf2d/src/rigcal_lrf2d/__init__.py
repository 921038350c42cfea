"""2D laser range finders for rigcal."""

from __future__ import annotations

import rigcal.plugin as rp
from rigcal.plugin.contract import SensorType
from rigcal.ranging import RANGE_BIAS, RangeEffects
from rigcal_lrf2d.combine import combine
from rigcal_lrf2d.config import Lrf2dConfig
from rigcal_lrf2d.decode import LASER_SCAN, MESSAGE_TYPES, decode, describe, view
from rigcal_lrf2d.detector import detect
from rigcal_lrf2d.fit import fit
from rigcal_lrf2d.near import near
from rigcal_lrf2d.residual import errors, measured_at, residual
from rigcal_lrf2d.scan import Scan
from rigcal_lrf2d.simulator import MESSAGE_TYPE, encode, observe, sees, simulate

__all__ = ["LRF2D", "Lrf2dConfig", "Scan", "rigcal_sensor_types"]

LRF2D = SensorType(
    name="lrf2d",
    config=Lrf2dConfig,
    message_types=MESSAGE_TYPES,
    decode=decode,
    detect=detect,
    combine=combine,
    near=near,
    residual=residual,
    errors=errors,
    unit="m",
    measured_at=measured_at,
    observe=observe,
    simulate=simulate,
    encode=encode,
    message_type=MESSAGE_TYPE,
    effects=RangeEffects,
    sees=sees,
    flat=True,
    view=view,
    fit=fit,
    describes={LASER_SCAN: describe},
    refinable={"range_bias": RANGE_BIAS},
    bends=True,
)


@rp.hookimpl
def rigcal_sensor_types() -> list[SensorType]:
    """The one sensor type of this package."""
    return [LRF2D]
