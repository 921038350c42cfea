"""Why a sensor's pose is not well determined, as far as its boards tell, and what to record."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.edge import SensorTargetEdge

# Boards are alike when their tilts differ by less (rad), when their distances differ by less than
# this share, and when they are seen within this angle (rad).
_ALIKE, _SAME_SHARE, _SAME_VIEW = np.radians(3.0), 0.1, np.radians(10.0)
_FEW = 5
Reasons = tuple[tuple[str, ...], tuple[str, ...]]
"""Causes, and what to record next."""


def explain(
    sensor: str,
    edges: Sequence[SensorTargetEdge],
    sensors: Mapping[str, Array],
    targets: Mapping[str, Array],
    is_flat: bool,
) -> Reasons:
    """What the boards have in common that this sensor shares with others."""
    own = [e.exposure for e in edges if e.sensor == sensor]
    if not own:
        return ("none of its data could be used",), ("the board in its view and another's",)
    T_s_t = se3.inverse(sensors[sensor]) @ np.stack([targets[k] for k in own])
    found = [
        _few(sensor, own, edges),
        _tilts(T_s_t, is_flat),
        _distance(T_s_t),
        _view(T_s_t),
    ]
    known = [reason for reason in found if reason]
    if not known:
        known = [
            (
                f"its {len(own)} exposures are too alike, or too noisy",
                "more exposures, with other places and tilts of the board",
            )
        ]
    causes, advice = zip(*known, strict=True)
    return tuple(causes), tuple(dict.fromkeys(advice))


def _few(sensor: str, own: Sequence[str], edges: Sequence[SensorTargetEdge]) -> _Reason:
    if len(own) > _FEW:
        return None
    mine = set(own)
    partners = Counter(e.sensor for e in edges if e.exposure in mine and e.sensor != sensor)
    shared = ", ".join(f"{n} with {partner}" for partner, n in partners.items())
    count = f"{len(own)} exposure{'s' * (len(own) != 1)}"
    return (
        f"it shares {count} only ({shared})",
        f"10 exposures or more that it shares with {' or '.join(partners)}",
    )


def _tilts(T_s_t: Array, is_flat: bool) -> _Reason:
    """`is_flat`: the sensor looks along its plane z = 0 only."""
    n = T_s_t[:, :3, 2]
    tilts = np.sqrt(np.maximum(np.linalg.eigvalsh(n.T @ n / len(n)), 0.0))
    if tilts[1] < _ALIKE:
        return "all boards are parallel", "boards that are tilted in several directions"
    if is_flat and np.abs(n[:, 2]).max() < _ALIKE:
        return (
            "all boards stand at right angles to the plane of its scan",
            "boards that lean towards it and away from it, and to both sides",
        )
    if tilts[0] < _ALIKE:
        return (
            "all boards are turned about one axis only",
            "boards that are tilted about another axis too",
        )
    return None


def _distance(T_s_t: Array) -> _Reason:
    distances = np.linalg.norm(T_s_t[:, :3, 3], axis=1)
    if np.ptp(distances) > _SAME_SHARE * distances.mean():
        return None
    return (
        f"all boards stand at one distance, {distances.mean():.2g} m",
        "boards that are nearer and farther",
    )


def _view(T_s_t: Array) -> _Reason:
    d = T_s_t[:, :3, 3] / np.linalg.norm(T_s_t[:, :3, 3], axis=1, keepdims=True)
    middle = d.mean(axis=0) / np.linalg.norm(d.mean(axis=0))
    if np.arccos(np.clip(d @ middle, -1, 1)).max() > _SAME_VIEW:
        return None
    return "the board is always in the same part of its view", "boards in other parts of its view"


_Reason = tuple[str, str] | None
