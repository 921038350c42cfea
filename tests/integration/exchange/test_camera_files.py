"""Lenses and poses in the files of Kalibr, OpenCV and ROS: read back by others, to 1e-9."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
import yaml

import rigcal
from rigcal.calibration import Calibration, RefinedNumber, SensorResult
from rigcal.errors import InputError
from rigcal.geometry import se3
from rigcal.plugin import Registry, Rig
from rigcal_camera import CAMERA, CameraConfig, lens_of

T_LIDAR = {
    "lidar": np.eye(4),
    "left": se3.exp(np.array([-1.2, 1.1, -1.3, 0.1, -0.2, 0.3])),
    "right": se3.exp(np.array([-1.1, 1.3, -1.0, 0.3, -0.1, 0.5])),
    "rear": se3.exp(np.array([0.4, 2.1, -0.2, -0.6, 0.7, 0.1])),
}
CALIBRATION = Calibration("lidar", {n: SensorResult("lidar", T) for n, T in T_LIDAR.items()})
REGISTRY = Registry.from_entry_points()


def _camera(*distortion: float, model: str = "pinhole", **more: Any) -> CameraConfig:
    content = {"width_px": 1280, "height_px": 960, "focal_px": (1 / 3 + 700, 701.5)}
    content |= {"principal_px": (640.1, 479.9), "model": model, "distortion": distortion}
    return CameraConfig.model_validate(content | more)


SENSORS = {
    "lidar": REGISTRY.sensor_type("lrf3d").config(type="lrf3d"),
    "left": _camera(-0.3, 0.1, 1e-4, -2e-5, topic="/left/image"),
    "right": _camera(),
    "rear": _camera(0.01, -0.002, 3e-4, -1e-5, model="fisheye"),
}
RIG = Rig("rig", "lidar", {}, SENSORS)


def _with(name: str, config: CameraConfig) -> Rig:
    return Rig("rig", "lidar", {}, SENSORS | {name: config})


def test_camchain_composes_to_the_poses() -> None:
    text: Any = rigcal.export(CALIBRATION, REGISTRY, "kalibr", RIG)
    chain = yaml.safe_load(text)
    assert list(chain) == ["cam0", "cam1", "cam2"]
    assert "T_cn_cnm1: p_cam(n) = T_cn_cnm1 @ [p_cam(n-1), 1]" in text
    T_cn_left = np.eye(4)
    for n, name in enumerate(("left", "right", "rear")):
        entry = chain[f"cam{n}"]
        assert f"# cam{n} is {name} of the rig." in text
        if n:
            T_cn_left = np.array(entry["T_cn_cnm1"]) @ T_cn_left
        expected = np.linalg.inv(T_LIDAR[name]) @ T_LIDAR["left"]
        np.testing.assert_allclose(T_cn_left, expected, rtol=0, atol=1e-9)
        lens = SENSORS[name]
        assert entry["intrinsics"] == [*lens.focal_px, *lens.principal_px]
        assert entry["resolution"] == [1280, 960]
        assert entry["distortion_coeffs"] == list(lens.distortion or [0.0] * 4)
        assert entry["camera_model"] == "pinhole"
    models = [entry["distortion_model"] for entry in chain.values()]
    assert models == ["radtan", "radtan", "equidistant"]
    assert chain["cam0"]["rostopic"] == "/left/image"
    assert "T_cn_cnm1" not in chain["cam0"]


def test_camchain_refuses_a_lens_that_kalibr_cannot_hold() -> None:
    zero = _with("right", _camera(-0.3, 0.1, 0.0, 0.0, 0.0))
    text: Any = rigcal.export(CALIBRATION, REGISTRY, "kalibr", zero)
    assert yaml.safe_load(text)["cam1"]["distortion_coeffs"] == [-0.3, 0.1, 0.0, 0.0]
    with pytest.raises(InputError, match="camera 'right' has 5 numbers of distortion"):
        rigcal.export(
            CALIBRATION, REGISTRY, "kalibr", _with("right", _camera(-0.3, 0.1, 0, 0, 0.02))
        )


def _storage(text: str) -> Any:
    return cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)


@pytest.mark.parametrize(
    "camera",
    [
        SENSORS["left"],
        SENSORS["right"],
        SENSORS["rear"],
        _camera(-0.3, 0.1, 1e-4, -2e-5, 0.01, 0.02, -0.01, 0.001, 1e-4, 2e-4, 3e-4, 4e-4),
    ],
    ids=["radtan", "none", "fisheye", "prism"],
)
def test_opencv_projects_with_its_file_as_rigcal_does(camera: CameraConfig) -> None:
    texts: Any = rigcal.export(CALIBRATION, REGISTRY, "opencv", _with("right", camera))
    assert set(texts) == {"left.yaml", "right.yaml", "rear.yaml"}
    assert "p_camera = R p_root + T" in texts["right.yaml"]
    file = _storage(texts["right.yaml"])
    assert file.getNode("image_width").real() == 1280
    assert file.getNode("image_height").real() == 960
    K, D, R, T = (
        file.getNode(key).mat() for key in ("camera_matrix", "distortion_coefficients", "R", "T")
    )
    rng = np.random.default_rng(0)
    p_s = np.column_stack([rng.uniform(-1, 1, (50, 2)), rng.uniform(2, 4, 50)])
    p_lidar = se3.apply(T_LIDAR["right"], p_s)
    fisheye = file.getNode("distortion_model").string() == "fisheye"
    project = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
    uv = project(p_lidar.reshape(-1, 1, 3), cv2.Rodrigues(R)[0], T, K, D)[0].reshape(-1, 2)
    np.testing.assert_allclose(uv, lens_of(camera).pixels_from_points(p_s)[0], rtol=0, atol=1e-7)
    expected = np.linalg.inv(T_LIDAR["right"])[:3]
    np.testing.assert_allclose(np.hstack([R, T]), expected, rtol=0, atol=1e-9)
    assert file.getNode("root").string() == "lidar"


@pytest.mark.parametrize(
    ("camera", "model", "count"),
    [
        (SENSORS["left"], "plumb_bob", 5),
        (SENSORS["rear"], "equidistant", 4),
        (_camera(-0.3, 0.1, 1e-4, -2e-5, 0.1, 0.2, 0.3, 0.4), "rational_polynomial", 8),
    ],
)
def test_camera_info_is_laid_out_as_ros_reads_it(
    camera: CameraConfig, model: str, count: int
) -> None:
    texts: Any = rigcal.export(CALIBRATION, REGISTRY, "camera-info", _with("right", camera))
    assert "frame_id right_optical_frame" in texts["right.yaml"]
    info = yaml.safe_load(texts["right.yaml"])
    assert (info["camera_name"], info["image_width"], info["image_height"]) == ("right", 1280, 960)

    def matrix(key: str) -> Any:
        return np.array(info[key]["data"]).reshape(info[key]["rows"], info[key]["cols"])

    (fx, fy), (cx, cy) = camera.focal_px, camera.principal_px
    K = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]
    np.testing.assert_array_equal(matrix("camera_matrix"), K)
    np.testing.assert_array_equal(matrix("projection_matrix"), np.hstack([K, np.zeros((3, 1))]))
    np.testing.assert_array_equal(matrix("rectification_matrix"), np.eye(3))
    assert info["distortion_model"] == model
    D = matrix("distortion_coefficients")
    assert D.shape == (1, count)
    np.testing.assert_array_equal(D[0, : len(camera.distortion)], camera.distortion)


def test_camera_info_with_plain_lists_is_read() -> None:
    K = [500.0, 0, 320, 0, 501.0, 240, 0, 0, 1]
    content = {"image_width": 640, "image_height": 480, "camera_matrix": K}
    content |= {"distortion_model": "plumb_bob", "distortion_coefficients": [-0.3, 0.1, 0, 0]}
    read = REGISTRY.importers["camera-info"].read(yaml.safe_dump(content), "front")
    assert read is not None
    lens = read.sensors["front"]
    assert lens["focal_px"] == [500, 501]
    assert lens["principal_px"] == [320, 240]
    assert lens["distortion"] == [-0.3, 0.1, 0, 0]


def test_files_hold_the_lens_that_was_refined() -> None:
    start = _camera(-0.3, 0.1, 1e-4, -2e-5, refine=["lens"])
    names = CAMERA.refinable["lens"].parameters(start).names
    values = [711.0, 712.0, 641.0, 481.0, -0.31, 0.11, 2e-4, -3e-5]
    refined = {n: RefinedNumber(v, 0.1, 0.0) for n, v in zip(names, values, strict=True)}
    result = SensorResult("lidar", T_LIDAR["right"], refined=refined)
    calibration = Calibration("lidar", dict(CALIBRATION.sensors) | {"right": result})
    text: Any = rigcal.export(calibration, REGISTRY, "kalibr", _with("right", start))
    entry = yaml.safe_load(text)["cam1"]
    assert entry["intrinsics"] + entry["distortion_coeffs"] == values


@pytest.mark.parametrize("form", ["kalibr", "opencv", "camera-info"])
def test_without_a_camera_there_is_nothing_to_write(form: str) -> None:
    alone = Calibration("lidar", {"lidar": SensorResult("lidar", np.eye(4))})
    with pytest.raises(InputError, match=r"none of the sensors \(lidar\) is a camera"):
        rigcal.export(alone, REGISTRY, form, RIG)
