"""The cloud of all lasers in the root's frame, coloured by the cameras."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigcal.calibration import Calibration
from rigcal.errors import ConfigError
from rigcal.fusing.colour import Image, dots_by_range, sample, visible
from rigcal.fusing.moment import moment
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.plugin.contract import FrameView
from rigcal.plugin.registry import Registry
from rigcal.refined import rig_as_refined
from rigcal.rig import Rig

SCAN_COLOURS = ((230, 60, 40), (20, 120, 220), (240, 160, 0), (140, 60, 190), (0, 150, 110))


@dataclass(frozen=True, eq=False)
class Fused:
    """One moment, in the root's frame.

    `points` (N, 3), `colours` (N, 3) RGB, and `sensor` (N,), an index into `sensors`. `camera` (N,)
    is an index into `cameras`, of the one that gave the colour: -1 where none saw the point (grey),
    and for flat scans, which have a colour of their own. `overlays` are images by camera with the
    visible points on them, coloured by range. `lag_s`: each sensor's frame was taken so much later
    than that of `leader` (0 where stamps are missing). `up` is upward in the root's frame.
    """

    leader: str
    points: Array
    colours: Image
    sensor: NDArray[np.intp]
    sensors: tuple[str, ...]
    camera: NDArray[np.intp]
    cameras: tuple[str, ...]
    overlays: Mapping[str, Image] = field(default_factory=dict)
    lag_s: Mapping[str, float] = field(default_factory=dict)
    places: Mapping[str, Array] = field(default_factory=dict)
    up: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))


def fuse(
    rig: Rig,
    registry: Registry,
    recording: Path | str,
    calibration: Calibration,
    number: int | None = None,
) -> Fused:
    """What the sensors saw when the cloud `number` was taken (None: the middle one).

    The clouds of 3D sensors are coloured by the cameras, the one nearest in time first: each point
    by the pixel at which the camera's lens images it, unless a nearer point hides it there. Flat
    scans lie in their places. ConfigError when the rig has no sensor that sees points, or the
    calibration lacks one of its sensors; RecordingError for data that cannot be read.
    """
    _check(rig, calibration)
    leader = _leader(rig, registry)
    messages = moment(rig, registry, recording, leader, number)
    rig = rig_as_refined(rig, registry, calibration)
    views = {name: _view(rig, registry, name, m) for name, m in messages.items()}
    lags = {n: (m.stamp_ns - messages[leader].stamp_ns) * 1e-9 for n, m in messages.items()}
    clouds = {n: _in_root(calibration, n, v) for n, v in views.items() if v.points is not None}
    if not clouds:
        raise _without_points(rig)
    images = {
        n: v.image
        for n, v in views.items()
        if v.image is not None and registry.sensor_type(rig.sensors[n].type).project is not None
    }
    cameras = tuple(sorted(images, key=lambda n: (abs(lags[n]), list(rig.sensors).index(n))))
    flat = frozenset(n for n in clouds if registry.sensor_type(rig.sensors[n].type).flat)
    points = np.concatenate(list(clouds.values()))
    sensor = np.repeat(np.arange(len(clouds)), [len(c) for c in clouds.values()])
    solid = ~np.isin(sensor, [i for i, n in enumerate(clouds) if n in flat])
    colours, camera = _unseen(clouds, flat), np.full(len(points), -1)
    overlays = {}
    for index, name in enumerate(cameras):
        uv, ranges, shown = _seen(rig, registry, calibration, name, points)
        overlays[name] = _overlay(images[name], uv[shown], ranges[shown])
        new = shown & solid & (camera < 0)
        colours[new], camera[new] = sample(images[name], uv[new]), index
    return Fused(
        leader, points, colours, sensor, tuple(clouds), camera, cameras, overlays, lags,
        {n: calibration.T(calibration.root, n)[:3, 3] for n in messages}, calibration.up,
    )  # fmt: skip


def _check(rig: Rig, calibration: Calibration) -> None:
    missing = [name for name in rig.sensors if name not in calibration.sensors]
    if missing:
        raise ConfigError(
            f"the calibration does not place {', '.join(missing)} of this rig "
            f"(it has {', '.join(calibration.sensors)}); give the rig file that it was made with"
        )


def _leader(rig: Rig, registry: Registry) -> str:
    """The sensor whose frame sets the time: the first 3D one, else the first that sees points."""
    kinds = {name: registry.sensor_type(config.type) for name, config in rig.sensors.items()}
    seeing = [n for n, k in kinds.items() if k.view is not None and k.project is None]
    if not seeing:
        raise _without_points(rig)
    return next((n for n in seeing if not kinds[n].flat), seeing[0])


def _without_points(rig: Rig) -> ConfigError:
    return ConfigError(
        f"no sensor of rig '{rig.name}' sees points: fuse needs a laser beside the cameras"
    )


def _view(rig: Rig, registry: Registry, name: str, message: object) -> FrameView:
    config = rig.sensors[name]
    view = registry.sensor_type(config.type).view
    assert view is not None
    return view(message, config)  # type: ignore[arg-type]


def _in_root(calibration: Calibration, name: str, view: FrameView) -> Array:
    points = np.asarray(view.points, np.float64)
    points = points[np.all(np.isfinite(points), axis=1)]
    return se3.apply(calibration.T(calibration.root, name), points)


def _unseen(clouds: Mapping[str, Array], flat: frozenset[str]) -> Image:
    """Grey, and for each flat scan a colour of its own."""
    own = {n: SCAN_COLOURS[i % len(SCAN_COLOURS)] for i, n in enumerate(sorted(flat))}
    parts = [np.tile(own.get(n, (150, 150, 150)), (len(c), 1)) for n, c in clouds.items()]
    return np.concatenate(parts).astype(np.uint8)


def _seen(
    rig: Rig, registry: Registry, calibration: Calibration, name: str, points: Array
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Pixels (N, 2), ranges (N,), and which points the camera shows."""
    config = rig.sensors[name]
    project = registry.sensor_type(config.type).project
    assert project is not None
    p_c = se3.apply(se3.inverse(calibration.T(calibration.root, name)), points)
    uv, inside = project(p_c, config)
    ranges = np.linalg.norm(p_c, axis=1)
    return uv, ranges, visible(uv, ranges, inside)


def _overlay(image: Image, uv: Array, ranges: Array) -> Image:
    """A copy of the image (H, W, 3) with points on it."""
    picture = np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else image.copy()
    dots_by_range(picture, uv, ranges)
    return picture
