"""Pictures from the recording: what was found in blue, where the board should be in red."""

from __future__ import annotations

import base64
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar, Literal

import cv2
import numpy as np
import pytest

from rigcal.calibration import Calibration, Rejection, SensorResult
from rigcal.errors import RecordingError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.observation import (
    Candidate,
    Detection,
    Geometry,
    LineGeometry,
    Observation,
    PlaneGeometry,
    PointGeometry,
    PoseGeometry,
)
from rigcal.plugin import FrameView, SensorConfig, SensorType, hookimpl
from rigcal.plugin.registry import Registry
from rigcal.report.pictures import Pictures, pictures
from rigcal.rig import parse_rig

T_EYE_BEAM = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])
T_EYE_BOARD = se3.transform(np.eye(3), np.array([0.0, 0.0, 2.0]))
"""Two metres ahead."""
IMAGE = np.full((120, 160), 128, np.uint8)
HALF = (0.4, 0.3)
"""Of the board: 8 x 6 squares of 0.1 m."""
RED, BLUE = (0, 2), (2, 0)
"""The channel of a colour, and that of the other."""


class EyeConfig(SensorConfig, frozen=True):
    """A camera of 100 px focal length."""

    optical: ClassVar[bool] = True
    type: Literal["eye"] = "eye"


class BeamConfig(SensorConfig, frozen=True):
    """A laser; or anything else that shows pictures."""

    type: Literal["beam"] = "beam"


def _view(message: Any, config: Any) -> FrameView:
    try:
        frame = np.load(message.value)
    except ValueError as error:
        raise RecordingError(f"{message.origin}: {error}") from error
    return FrameView(image=frame) if frame.dtype == np.uint8 else FrameView(points=frame)


def _project(points: Array, config: Any) -> tuple[Array, Any]:
    return 100 * points[:, :2] / points[:, 2:] + (80, 60), points[:, 2] > 0


class Sensors:
    @hookimpl
    def rigcal_sensor_types(self) -> list[SensorType]:
        def detect(*_: object) -> Detection:
            raise AssertionError("these tests hand over observations")

        made = (".npy",), detect, detect
        return [
            SensorType("eye", EyeConfig, *made, view=_view, project=_project),
            SensorType("beam", BeamConfig, *made, view=_view),
        ]


Draw = Callable[..., Pictures]


@pytest.fixture
def draw(tmp_path: Path) -> Draw:
    """`draw(frames, found, rejected, solved)`: pictures of frames by sensor and exposure.

    What was `found` in a frame is a geometry; exposures that are not `solved` are not part of the
    solution.
    """
    board = {"type": "checkerboard", "columns": 7, "rows": 5, "square_size_m": 0.1}
    sensors = {name: {"type": name, "files": f"{name}_*.npy"} for name in ("eye", "beam")}
    registry = Registry([Sensors()])
    content = {"version": 1, "root": "eye", "targets": {"board": board}, "sensors": sensors}
    rig = parse_rig(content, registry)
    placed = {"eye": SensorResult("eye", np.eye(4)), "beam": SensorResult("eye", T_EYE_BEAM)}

    def run(
        frames: dict[tuple[str, str], Any],
        found: dict[tuple[str, str], Geometry],
        rejected: set[tuple[str, str]] = frozenset(),  # type: ignore[assignment]
        solved: str = "",
    ) -> Pictures:
        observations = []
        for sensor, exposure in {**frames, **found}:
            key, name = (sensor, exposure), f"{sensor}_{exposure}.npy"
            if key in frames:
                content = frames[key]
                if isinstance(content, bytes):
                    (tmp_path / name).write_bytes(content)
                else:
                    np.save(tmp_path / name, content)
            candidates = (Candidate(found[key], {}),) if key in found else ()
            observations.append(Observation(sensor, exposure, 0, name, candidates, "none"))
        lost = tuple(Rejection(*key, "", "too far off") for key in rejected)
        calibration = Calibration("eye", placed, dict.fromkeys(solved, T_EYE_BOARD), lost)
        return pictures(tmp_path, calibration, observations, rig, registry)

    return run


def decoded(uri: str) -> Array:
    data = base64.b64decode(uri.removeprefix("data:image/jpeg;base64,"))
    picture: Array = cv2.imdecode(np.frombuffer(data, np.uint8), 1)[..., ::-1].astype(float)
    return picture


def drawn(picture: Array, channels: tuple[int, int], u: float, v: float) -> bool:
    """Whether that colour is within two pixels of a place."""
    u, v = round(u), round(v)
    part = picture[max(v - 2, 0) : v + 3, max(u - 2, 0) : u + 3]
    return bool((part[..., channels[0]] - part[..., channels[1]] > 50).any())


def has(picture: Array, channels: tuple[int, int]) -> bool:
    return bool((picture[..., channels[0]] - picture[..., channels[1]] > 50).any())


def _eye_pose(x: float, z: float = 2.0) -> PoseGeometry:
    return PoseGeometry(se3.transform(np.eye(3), np.array([x, 0.0, z])), np.eye(6))


def test_a_frame_that_was_not_used_shows_what_was_found_and_what_was_expected(draw: Draw) -> None:
    frames = {("eye", e): IMAGE for e in "123"}
    found: dict[tuple[str, str], Geometry] = {("eye", "1"): _eye_pose(0.3)}
    shown = draw(frames, found, {("eye", "1")}, "12")
    assert shown.thumbnails is not None
    first, second, third = (decoded(shown.thumbnails["eye", e]) for e in "123")
    assert first.shape == (120, 160, 3)
    half_u, half_v = (50 * side for side in HALF)
    # Found 0.3 m to the right of where the other sensors say that the board was.
    assert drawn(first, BLUE, 80 + 15 + half_u, 60)
    assert drawn(first, RED, 80 - half_u, 60)
    assert drawn(first, RED, 80 - half_u + 5, 60 - half_v)
    assert not drawn(first, BLUE, 80 - half_u, 60)
    assert (has(second, BLUE), has(second, RED)) == (False, True)
    assert (has(third, BLUE), has(third, RED)) == (False, False)
    assert shown.overlays == ()


def test_a_board_behind_the_camera_is_not_drawn(draw: Draw) -> None:
    shown = draw({("eye", "1"): IMAGE}, {("eye", "1"): _eye_pose(0.1, -2.0)})
    assert shown.thumbnails is not None
    assert not has(decoded(shown.thumbnails["eye", "1"]), BLUE)


def _ahead(x: float, y: float, z: float = 0.0) -> Array:
    return np.array([x, y, z])


LINE = LineGeometry(_ahead(1.0, -0.5), _ahead(1.0, 0.5), np.eye(6))
RIM = np.array([_ahead(1.0, -0.5, -0.3), _ahead(1.0, 0.5, -0.3), _ahead(1.0, 0.5, 0.3)])
FOUND: dict[str, tuple[Geometry, list[tuple[float, float]]]] = {
    "line": (LINE, [(1.0, -0.5), (1.0, 0.0), (1.0, 0.5)]),
    "plane": (
        PlaneGeometry(_ahead(-1, 0), 1.0, _ahead(1.0, 0.0), np.eye(3), boundary=RIM),
        [(1.0, -0.5), (1.0, 0.5)],
    ),
    "plane without rim": (
        PlaneGeometry(_ahead(-1, 0), 1.0, _ahead(1.0, 0.2), np.eye(3)),
        [(1.0, 0.2)],
    ),
    "point": (PointGeometry(_ahead(1.0, -0.4), np.eye(3), np.zeros(3)), [(1.0, -0.4)]),
    "pose": (
        PoseGeometry(se3.inverse(T_EYE_BEAM) @ T_EYE_BOARD, np.eye(6)),
        [(2.0, -HALF[0]), (2.0, HALF[0])],
    ),
}


@pytest.mark.parametrize("what", FOUND)
def test_points_are_drawn_from_above_with_what_was_found(draw: Draw, what: str) -> None:
    """Ahead is up, left is left; the farthest shape is in the picture."""
    geometry, places = FOUND[what]
    points = np.array([_ahead(1.0, 0.0), _ahead(-0.5, 0.5), [np.nan] * 3])
    shown = draw({("beam", "1"): points}, {("beam", "1"): geometry})
    assert shown.thumbnails is not None
    picture = decoded(shown.thumbnails["beam", "1"])
    assert picture.shape == (132, 176, 3)
    scale = 132 / 2.4 / max(max(map(abs, place)) for place in places)
    for x, y in places:
        assert drawn(picture, BLUE, 88 - scale * y, 66 - scale * x), (x, y)
    assert not has(picture, RED)
    u, v = round(88 - scale * 0.5), round(66 + scale * 0.5)
    assert picture[v, u].max() < 190  # the second point, grey
    assert picture[5, 5].min() > 240


def test_points_without_a_board_fill_the_picture(draw: Draw) -> None:
    angles = np.linspace(0, 2 * np.pi, 40)
    ring = 10 * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(40)])
    shown = draw({("beam", "1"): ring, ("beam", "2"): np.empty((0, 3))}, {})
    assert shown.thumbnails is not None
    picture, empty = (decoded(shown.thumbnails["beam", e]) for e in "12")
    dark = np.argwhere(picture.max(axis=2) < 190)
    away = np.linalg.norm(dark - (66, 88), axis=1)
    assert np.abs(away[away > 8] - 132 / 2.4).max() < 3
    assert empty[:40].min() > 240  # only the sensor's own cross


def test_points_of_a_laser_lie_on_the_image_of_the_same_exposure(draw: Draw) -> None:
    """Those of one ray at one place; far ones are red."""
    near, far = ([[r, y * r / 2, z * r / 2] for z in (-0.1, 0.1)] for r, y in ((1, 0.2), (3, -0.2)))
    points = np.array([*near, *far, [np.nan] * 3])
    both = {("eye", "1"): _eye_pose(0.0), ("beam", "1"): LINE}
    shown = draw({("eye", "1"): IMAGE, ("beam", "1"): points}, both, solved="1")
    (overlay,) = shown.overlays
    assert (overlay.camera, overlay.laser, overlay.exposure) == ("eye", "beam", "1")
    picture = decoded(overlay.uri)
    dark = picture.max(axis=2) < 100
    dots = {(u, v) for u in (70, 90) for v in (55, 65)}  # left is smaller u
    assert all(dark[v, u] for u, v in dots)
    within = np.argwhere(dark[50:70, 63:98])
    assert max(min(abs(50 + v - y) + abs(63 + u - x) for x, y in dots) for v, u in within) <= 3
    redness = picture[..., 0] - picture[..., 2]
    assert min(redness[55, 90], redness[65, 90]) > max(redness[55, 70], redness[65, 70]) + 20
    assert drawn(picture, RED, 80 + 50 * HALF[0], 60)  # where the board is, by the solution
    assert shown.thumbnails == {}


def test_a_laser_that_returned_nothing_leaves_the_image_as_it_is(draw: Draw) -> None:
    both = {("eye", "1"): _eye_pose(0.0), ("beam", "1"): LINE}
    nothing = np.full((5, 3), np.nan)
    (overlay,) = draw({("eye", "1"): IMAGE, ("beam", "1"): nothing}, both, solved="1").overlays
    picture = decoded(overlay.uri)
    assert drawn(picture, RED, 80 + 50 * HALF[0], 60)
    assert np.ptp(picture[50:70, 65:95], axis=2).max() < 10


def test_what_is_no_image_or_no_points_is_no_overlay(draw: Draw) -> None:
    """Sensor types may show an image and not say where points are in it."""
    frames = {("eye", "1"): IMAGE, ("beam", "1"): IMAGE, ("beam", "2"): IMAGE}
    both = {("eye", "1"): _eye_pose(0.0), ("beam", "1"): LINE, ("beam", "2"): LINE}
    shown = draw(frames, both, {("beam", "2")}, "12")
    assert shown.overlays == ()
    assert shown.thumbnails is not None
    picture = decoded(shown.thumbnails["beam", "2"])
    assert (has(picture, RED), has(picture, BLUE)) == (False, False)


def test_frames_that_are_gone_or_damaged_are_passed_over(draw: Draw) -> None:
    frames: dict[tuple[str, str], Any] = {("eye", "1"): b"torn", ("eye", "3"): IMAGE}
    shown = draw(frames, {("eye", "2"): _eye_pose(0.0)})  # of 2 there is no file
    assert list(shown.thumbnails or ()) == [("eye", "3")]
