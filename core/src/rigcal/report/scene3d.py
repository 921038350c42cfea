"""What the report's 3D view draws, as plain numbers for its script."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rigcal.calibration import Calibration
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.plugin.registry import Registry
from rigcal.report.view import rims
from rigcal.rig import Rig

_DIGITS = 4
_REACH = 0.5
"""Fields of view are drawn to this share of the boards' middle distance."""
_ELLIPSOID = 0.06
"""The largest ellipsoid is drawn to about this share of the rig's extent."""


def scene3d(
    calibration: Calibration, rig: Rig, registry: Registry, boards: Mapping[str, Array]
) -> str:
    """JSON, all in the root's frame, m: sensors, boards, `up` (3,), and `magnification`.

    A sensor has a name, `T` (its pose, row by row), `views` (curves) and `ellipsoid`: the columns
    are semi-axes of one standard deviation of its place. `boards` (K, 3) are outlines by exposure.
    """
    poses = {name: calibration.T(calibration.root, name) for name in calibration.sensors}
    places = np.array([T[:3, 3] for T in poses.values()])
    middles = np.array([outline.mean(axis=0) for outline in boards.values()]).reshape(-1, 3)
    extent = max(float(np.ptp(places, axis=0).max()), 0.1)
    reach = reach_of(places, middles, extent)
    axes = {name: semi_axes(calibration, name, T) for name, T in poses.items()}
    sensors = [
        {
            "name": name,
            "T": _rounded(T[:3]),
            "views": _views(rig, registry, name, T, reach),
            "ellipsoid": None if axes[name] is None else _rounded(axes[name], 8),
        }
        for name, T in poses.items()
    ]
    content = {
        "root": calibration.root,
        "up": _rounded(calibration.up),
        "magnification": magnification([a for a in axes.values() if a is not None], extent),
        "sensors": sensors,
        "boards": [{"name": k, "outline": _rounded(v)} for k, v in boards.items()],
    }
    # "</" would end the script element that holds it.
    return json.dumps(content, separators=(",", ":")).replace("</", "<\\/")


def _views(rig: Rig, registry: Registry, name: str, T: Array, reach: float) -> list[Any]:
    if name not in rig.sensors:
        return []
    config = rig.sensors[name]
    curves = rims(registry.sensor_type(config.type), config, reach)
    return [_rounded(se3.apply(T, curve), 3) for curve in curves]


def reach_of(sensors: Array, boards: Array, extent: float) -> float:
    """How far fields of view are drawn (m): sensors (S, 3) and boards (K, 3) in one frame."""
    distances = np.linalg.norm(boards - sensors.mean(axis=0), axis=1)
    return _REACH * float(np.median(distances)) if len(distances) else extent


def semi_axes(calibration: Calibration, name: str, T: Array) -> Array | None:
    """(3, 3) columns: semi-axes of the one-sigma ellipsoid of a sensor's place in its parent.

    Turned by T (4, 4): the sensor's pose in the root gives them in the root's frame.
    """
    covariance = calibration.sensors[name].covariance
    if covariance is None:
        return None
    values, vectors = np.linalg.eigh(T[:3, :3] @ covariance[3:, 3:] @ T[:3, :3].T)
    result: Array = vectors * np.sqrt(np.maximum(values, 0))
    return result


def magnification(axes: Sequence[Array], extent: float) -> int:
    """A round number (1, 2, 5 times a power of ten) that makes ellipsoids visible."""
    largest = max((float(np.linalg.norm(a, axis=0).max()) for a in axes), default=0.0)
    if largest <= 0:
        return 1
    wanted = max(_ELLIPSOID * extent / largest, 1.0)
    power = 10 ** np.floor(np.log10(wanted))
    return int(power * max(step for step in (1, 2, 5) if step * power <= wanted))


def _rounded(values: Array | None, digits: int = _DIGITS) -> Any:
    # Adding zero turns -0.0 into 0.0.
    return (np.round(np.asarray(values), digits) + 0.0).tolist()
