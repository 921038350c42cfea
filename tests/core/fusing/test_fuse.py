"""One moment of sensors that plugins bring: who gives points, who colours, who is left out."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import cv2
import numpy as np
import pytest
from plyfile import PlyData

from rigcal.calibration import Calibration, SensorResult
from rigcal.errors import ConfigError
from rigcal.fusing.fuse import Fused, fuse
from rigcal.fusing.write import write_fused
from rigcal.observation import Detection
from rigcal.plugin import FrameView, Registry, SensorConfig, SensorType, hookimpl
from rigcal.rig import parse_rig

GREY, ORANGE = (150, 150, 150), (250, 120, 10)


class LidarConfig(SensorConfig, frozen=True):
    type: Literal["lidar"] = "lidar"


class CameraConfig(SensorConfig, frozen=True):
    type: Literal["camera"] = "camera"


class PictureConfig(SensorConfig, frozen=True):
    type: Literal["picture"] = "picture"


def points(message: Any, config: Any) -> FrameView:
    return FrameView(points=np.loadtxt(message.value, ndmin=2).reshape(-1, 3))


def image(message: Any, config: Any) -> FrameView:
    return FrameView(image=np.full((40, 40, 3), ORANGE, np.uint8))


def project(p: Any, config: Any) -> Any:
    """A pinhole that looks along z, of 10 px focal length."""
    uv = 10 * p[:, :2] / p[:, 2:] + 20
    return uv, np.all((uv >= 0) & (uv < 40), axis=1) & (p[:, 2] > 0)


def _type(name: str, config: type[SensorConfig], **more: Any) -> SensorType:
    return SensorType(
        name, config, (".txt",), lambda *_: None, lambda *_: Detection((), "none"), **more
    )


@hookimpl
def rigcal_sensor_types() -> list[SensorType]:
    return [
        _type("lidar", LidarConfig, view=points),
        _type("camera", CameraConfig, view=image, project=project),
        _type("picture", PictureConfig, view=image),
    ]


PLUGIN: Any = SimpleNamespace(rigcal_sensor_types=rigcal_sensor_types)
REGISTRY = Registry([PLUGIN])


def fused(folder: Path, kinds: dict[str, str], placed: dict[str, str] | None = None) -> Fused:
    """Exposure pose1 of a rig whose sensors all stand in the root."""
    board = {"type": "checkerboard", "columns": 7, "rows": 5, "square_size_m": 0.1}
    sensors = {name: {"type": kind, "files": f"{name}/*.txt"} for name, kind in kinds.items()}
    content = {"version": 1, "root": next(iter(kinds)), "targets": {"b": board}}
    rig = parse_rig(content | {"sensors": sensors}, REGISTRY)
    results = {name: SensorResult(rig.root, np.eye(4)) for name in placed or kinds}
    return fuse(rig, REGISTRY, folder, Calibration(rig.root, results), number=0)


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Two exposures; the other camera has the second one only."""
    for name in ("lidar/pose1", "lidar/pose2", "cam/pose1", "cam/pose2", "other/pose2"):
        file = tmp_path / f"{name}.txt"
        file.parent.mkdir(exist_ok=True)
        file.write_text("0 0 2")
    return tmp_path


def test_a_camera_colours_what_it_sees(recording: Path) -> None:
    (recording / "lidar/pose1.txt").write_text("0 0 2\n0 0 -2\nnan nan nan\n")
    found = fused(recording, {"lidar": "lidar", "cam": "camera"})
    np.testing.assert_array_equal(found.points, [[0, 0, 2], [0, 0, -2]])
    np.testing.assert_array_equal(found.colours, [ORANGE, GREY])
    assert found.camera.tolist() == [0, -1]
    assert (found.overlays["cam"] != ORANGE).any()


def test_a_camera_that_has_no_file_of_the_exposure_is_left_out(recording: Path) -> None:
    found = fused(recording, {"lidar": "lidar", "cam": "camera", "other": "camera"})
    assert found.cameras == ("cam",)
    assert set(found.places) == {"lidar", "cam"}


def test_a_sensor_whose_type_cannot_project_colours_nothing_and_has_no_overlay(
    recording: Path,
) -> None:
    found = fused(recording, {"lidar": "lidar", "cam": "picture"})
    np.testing.assert_array_equal(found.colours, [GREY])
    assert not found.overlays


@pytest.mark.parametrize("kind", ["camera", "picture"])
def test_a_rig_that_sees_no_points_has_nothing_to_fuse(recording: Path, kind: str) -> None:
    with pytest.raises(ConfigError, match="sees points: fuse needs a laser beside the cameras"):
        fused(recording, {"cam": kind})


def test_a_calibration_of_another_rig_is_refused(recording: Path) -> None:
    kinds = {"lidar": "lidar", "cam": "camera"}
    with pytest.raises(ConfigError, match=r"does not place cam of this rig \(it has lidar\)"):
        fused(recording, kinds, {"lidar": "lidar"})


@pytest.mark.filterwarnings("ignore:loadtxt")
def test_a_moment_in_which_no_laser_saw_anything_is_an_empty_picture(recording: Path) -> None:
    (recording / "lidar/pose1.txt").write_text("")
    paths = write_fused(recording / "out", fused(recording, {"lidar": "lidar", "cam": "camera"}))
    assert len(PlyData.read(str(paths["cloud"]))["vertex"].data) == 0
    assert (cv2.imread(str(paths["picture"])) == 255).all()
    assert (cv2.imread(str(paths["overlay cam"])) == ORANGE[::-1]).all()
