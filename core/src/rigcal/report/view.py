"""What a sensor can see, as curves: the rim of its field of view."""

from __future__ import annotations

import numpy as np

from rigcal.geometry.se3 import Array
from rigcal.plugin.contract import SensorConfig, SensorType

_STEP_DEG = 0.75
_LEAST_DEG = 2.0
"""Rims shorter than this are grains of the sampling."""


def rims(kind: SensorType, config: SensorConfig, reach: float) -> list[Array]:
    """Curves (N, 3) in the sensor's frame at distance `reach` (m) around what it sees there.

    A flat sensor has one curve: the fan in its plane. Empty when it sees all around, or does not
    tell.
    """
    if kind.sees is None:
        return []
    return _fan(kind, config, reach) if kind.flat else _rims(kind, config, reach)


def _fan(kind: SensorType, config: SensorConfig, reach: float) -> list[Array]:
    turn = np.radians(np.arange(-180.0, 180.0, _STEP_DEG))
    directions = np.column_stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)])
    assert kind.sees is not None
    seen = kind.sees(reach * directions, config)
    if not seen.any():
        return []
    if seen.all():
        return [reach * np.vstack([directions, directions[:1]])]
    # Begin behind a gap, so that a fan across the seam stays one.
    gap = int(np.flatnonzero(~seen)[-1]) + 1
    directions, seen = np.roll(directions, -gap, axis=0), np.roll(seen, -gap)
    parts = np.split(directions, np.flatnonzero(np.diff(seen)) + 1)
    kept = [part for part, on in zip(parts, seen[_starts(parts)], strict=True) if on]
    apex = np.zeros((1, 3))
    return [np.vstack([apex, reach * part, apex]) for part in kept]


def _starts(parts: list[Array]) -> list[int]:
    return [0, *np.cumsum([len(part) for part in parts])[:-1].tolist()]


def _rims(kind: SensorType, config: SensorConfig, reach: float) -> list[Array]:
    import contourpy

    azimuth = np.radians(np.arange(-180.0, 180.0 + _STEP_DEG, _STEP_DEG))
    polar = np.radians(np.arange(0.0, 180.0 + _STEP_DEG / 2, _STEP_DEG))
    # The pole lies along y, which is ahead or up of no sensor frame of REP-103.
    grid = _sphere(*np.meshgrid(azimuth, polar))
    assert kind.sees is not None
    seen = kind.sees(reach * grid.reshape(-1, 3), config).reshape(grid.shape[:2])
    lines = contourpy.contour_generator(azimuth, polar, seen.astype(float)).lines(0.5)
    curves = [reach * _sphere(line[:, 0], line[:, 1]) for line in map(np.asarray, lines)]
    least = reach * np.radians(_LEAST_DEG)
    return [c for c in curves if np.ptp(c, axis=0).max() > least]


def _sphere(azimuth: Array, polar: Array) -> Array:
    """(..., 3) unit directions."""
    ring = np.sin(polar)
    return np.stack([ring * np.cos(azimuth), np.cos(polar), ring * np.sin(azimuth)], axis=-1)
