"""3D lasers for rigcal: board segmentation, range residuals, simulation."""

from __future__ import annotations

import rigcal.plugin as rp
from rigcal.plugin.contract import SensorType
from rigcal.ranging import RANGE_BIAS, RangeEffects
from rigcal_lrf3d.cloud import MESSAGE_TYPES, Cloud, decode, view
from rigcal_lrf3d.combine import combine
from rigcal_lrf3d.config import Lrf3dConfig
from rigcal_lrf3d.detector import detect
from rigcal_lrf3d.feature import fit, observe
from rigcal_lrf3d.near import near
from rigcal_lrf3d.residual import errors, measured_at, residual
from rigcal_lrf3d.scans import DepthScan, MultibeamScan, RosetteScan, SpinningScan
from rigcal_lrf3d.simulator import MESSAGE_TYPE, encode, sees, simulate

__all__ = [
    "LRF3D",
    "Cloud",
    "DepthScan",
    "Lrf3dConfig",
    "MultibeamScan",
    "RosetteScan",
    "SpinningScan",
    "rigcal_sensor_types",
]

LRF3D = SensorType(
    name="lrf3d",
    config=Lrf3dConfig,
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
    view=view,
    fit=fit,
    refinable={"range_bias": RANGE_BIAS},
    bends=True,
)


@rp.hookimpl
def rigcal_sensor_types() -> list[SensorType]:
    """The one sensor type of this package."""
    return [LRF3D]
