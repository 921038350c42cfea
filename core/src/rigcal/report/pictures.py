"""Pictures from the recording: laser points on images, and thumbnails of what was not used."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.calibration import Calibration
from rigcal.fusing.colour import Image, dots_by_range
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.observation import (
    Geometry,
    LineGeometry,
    Observation,
    PlaneGeometry,
    PoseGeometry,
)
from rigcal.plugin.contract import FrameView
from rigcal.plugin.registry import Registry
from rigcal.progress import Progress
from rigcal.report.boards import dense
from rigcal.report.frames import show_frames
from rigcal.report.sensor_errors import config_of, used
from rigcal.rig import Rig, build_targets

_OVERLAY_PX, _THUMB_PX = 640, 176
_OVERLAYS, _THUMBS = 12, 150
_FOUND, _EXPECTED = (36, 100, 180), (192, 57, 43)


@dataclass(frozen=True)
class Overlay:
    """The points of a laser on an image of the same exposure, as a data URI."""

    camera: str
    laser: str
    exposure: str
    uri: str


@dataclass(frozen=True)
class Pictures:
    """`overlays`, and `thumbnails` (data URIs) by sensor and exposure; `left_out` had no room."""

    overlays: tuple[Overlay, ...] = ()
    thumbnails: Mapping[tuple[str, str], str] | None = None
    left_out: int = 0


def pictures(
    recording: Path,
    calibration: Calibration,
    observations: Sequence[Observation],
    rig: Rig,
    registry: Registry,
    progress: Progress | None = None,
) -> Pictures:
    """All pictures of a report; RecordingError when the recording cannot be read."""
    pairs = _overlay_pairs(calibration, observations, rig, registry)
    shown = {(o.sensor, o.exposure) for o in used(calibration, observations)}
    missed = [o for o in observations if (o.sensor, o.exposure) not in shown and o.origin]
    # What was found and not used asks for an explanation first.
    missed.sort(key=lambda o: not o.candidates)
    kept = missed[:_THUMBS]
    for_overlay = {(o.sensor, o.exposure) for pair in pairs for o in pair}
    wanted = {(o.sensor, o.exposure): o for o in (*kept, *(o for pair in pairs for o in pair))}
    thumbs: dict[tuple[str, str], str] = {}
    views: dict[tuple[str, str], FrameView] = {}
    painter = _Painter(calibration, rig, registry)

    def show(o: Observation, view: FrameView) -> None:
        if (o.sensor, o.exposure) in for_overlay:
            views[o.sensor, o.exposure] = view
        else:
            thumbs[o.sensor, o.exposure] = painter.thumbnail(o, view)

    show_frames(recording, calibration, rig, registry, wanted.values(), show, progress)
    overlays = [
        painter.overlay(camera, laser, views)
        for camera, laser in pairs
        if {(camera.sensor, camera.exposure), (laser.sensor, laser.exposure)} <= set(views)
    ]
    return Pictures(tuple(o for o in overlays if o is not None), thumbs, len(missed) - len(kept))


def _overlay_pairs(
    calibration: Calibration, observations: Sequence[Observation], rig: Rig, registry: Registry
) -> list[tuple[Observation, Observation]]:
    """For each image sensor and each sensor of points, one exposure that both used."""
    by_exposure: dict[str, dict[str, Observation]] = {}
    for o in used(calibration, observations):
        by_exposure.setdefault(o.exposure, {})[o.sensor] = o
    images = {
        name
        for name, config in rig.sensors.items()
        if registry.sensor_type(config.type).project is not None
    }
    pairs: dict[tuple[str, str], tuple[Observation, Observation]] = {}
    # From the middle outwards: people are often still in the picture at the ends of a recording.
    exposures = list(by_exposure.values())
    middle = len(exposures) // 2
    for seen in sorted(exposures, key=lambda e: abs(exposures.index(e) - middle)):
        for camera in sorted(images & set(seen)):
            for laser in sorted(set(seen) - images):
                pairs.setdefault((camera, laser), (seen[camera], seen[laser]))
    return [pairs[key] for key in sorted(pairs)][:_OVERLAYS]


class _Painter:
    """Draws frames with what was found (blue) and where the solution expects the target (red)."""

    def __init__(self, calibration: Calibration, rig: Rig, registry: Registry) -> None:
        self.calibration, self.rig, self.registry = calibration, rig, registry
        self.targets = build_targets(rig, registry)

    def thumbnail(self, o: Observation, view: FrameView) -> str:
        found = [_shape(c.geometry, self._outline(o.sensor)) for c in o.candidates[:1]]
        expected = self._expected(o)
        if view.image is not None:
            return _jpeg(self._on_image(o.sensor, view.image, _THUMB_PX, found, expected))
        return _jpeg(_from_above(np.asarray(view.points), found, expected))

    def overlay(
        self, camera: Observation, laser: Observation, views: Mapping[tuple[str, str], FrameView]
    ) -> Overlay | None:
        """None if what the sensors saw is no image, or no points."""
        image = views[camera.sensor, camera.exposure].image
        points = views[laser.sensor, laser.exposure].points
        if image is None or points is None:
            return None
        expected = self._expected(camera)
        picture = self._on_image(camera.sensor, image, _OVERLAY_PX, [], expected)
        T_c_l = self.calibration.T(camera.sensor, laser.sensor)
        p_c = se3.apply(T_c_l, points[np.all(np.isfinite(points), axis=1)])
        uv, inside = self._project(camera.sensor, p_c)
        scale = picture.shape[1] / image.shape[1]
        dots_by_range(picture, scale * uv[inside], np.linalg.norm(p_c[inside], axis=1))
        return Overlay(camera.sensor, laser.sensor, camera.exposure, _jpeg(picture))

    def _on_image(
        self,
        sensor: str,
        image: Image,
        width: int,
        found: Sequence[Array],
        expected: Sequence[Array],
    ) -> Image:
        import cv2

        scale = min(width / image.shape[1], 1.0)
        size = (round(scale * image.shape[1]), round(scale * image.shape[0]))
        small: Any = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        picture = np.ascontiguousarray(
            small if small.ndim == 3 else cv2.cvtColor(small, cv2.COLOR_GRAY2RGB), np.uint8
        )
        for shapes, colour in ((found, _FOUND), (expected, _EXPECTED)):
            for shape in shapes:
                uv, inside = self._project(sensor, dense(shape))
                line = np.round(scale * uv[inside] * 8).astype(np.int32)
                cv2.polylines(picture, [line], bool(inside.all()), colour, 2, cv2.LINE_AA, 3)
        return picture

    def _project(self, sensor: str, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        config = config_of(self.calibration, self.rig, self.registry, sensor)
        project = self.registry.sensor_type(config.type).project
        if project is None or not len(points):
            return np.zeros((len(points), 2)), np.zeros(len(points), bool)
        return project(points, config)

    def _outline(self, sensor: str) -> Array:
        return self.targets[self.rig.target_of(sensor)].outline_points

    def _expected(self, o: Observation) -> list[Array]:
        """Where the solution has the target of this exposure, (K, 3) in the sensor's frame."""
        if o.exposure not in self.calibration.target_poses:
            return []
        T_s_root = se3.inverse(self.calibration.T(self.calibration.root, o.sensor))
        T_s_t = T_s_root @ self.calibration.target_poses[o.exposure]
        return [se3.apply(T_s_t, self._outline(o.sensor))]


def _shape(geometry: Geometry, outline: Array) -> Array:
    """What a detector found, as points (K, 3) in the sensor's frame."""
    match geometry:
        case PoseGeometry():
            return se3.apply(geometry.T_s_t, outline)
        case PlaneGeometry():
            return geometry.boundary if len(geometry.boundary) else geometry.center[None]
        case LineGeometry():
            return np.stack([geometry.start, geometry.end])
    return geometry.position[None]


def _from_above(points: Array, found: Sequence[Array], expected: Sequence[Array]) -> Image:
    """A scan or a cloud in its plane x, y: ahead is up, the sensor a cross."""
    import cv2

    height = round(0.75 * _THUMB_PX)
    shapes = [*found, *expected]
    reach = max((float(np.abs(s[:, :2]).max()) for s in shapes), default=0.0)
    points = points[np.all(np.isfinite(points), axis=1)]
    if not reach:
        distances = np.linalg.norm(points[:, :2], axis=1)
        reach = float(np.quantile(distances, 0.8)) if len(points) else 1.0
    scale = height / (2.4 * max(reach, 0.1))
    picture = np.full((height, _THUMB_PX, 3), 255, np.uint8)

    def pixels(p: Array) -> NDArray[np.int32]:
        uv = np.stack([_THUMB_PX / 2 - scale * p[:, 1], height / 2 - scale * p[:, 0]], axis=1)
        return np.round(uv).astype(np.int32)

    uv = pixels(points)
    inside = np.all((uv >= 0) & (uv < (_THUMB_PX, height)), axis=1)
    picture[uv[inside, 1], uv[inside, 0]] = 120
    for group, colour in ((found, _FOUND), (expected, _EXPECTED)):
        for shape in group:  # dense: of a single point OpenCV draws no line
            cv2.polylines(picture, [pixels(dense(shape))], True, colour, 2, cv2.LINE_AA)
    centre = (_THUMB_PX // 2, height // 2)
    cv2.drawMarker(picture, centre, (0, 0, 0), cv2.MARKER_CROSS, 7, 1)
    return picture


def _jpeg(picture: Image) -> str:
    import cv2

    ok, data = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 82])
    assert ok
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode()
