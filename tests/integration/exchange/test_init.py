"""`rigcal init`: a rig file that loads, from what a recording and other tools' files say."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

import rigcal
from rigcal.calibration import Calibration, SensorResult
from rigcal.errors import ConfigError, InputError, PluginError
from rigcal.geometry import se3
from rigcal.importing import import_file
from rigcal.plugin import Importer, PoseConfig, Registry, Rig, hookimpl
from rigcal.recording import ros
from rigcal.recording.writer import RecordingWriter
from rigcal.rig import T_root_sensors

REGISTRY = Registry.from_entry_points()
LENS = {"width_px": 64, "height_px": 48, "focal_px": [71.5, 70.25], "principal_px": [31.0, 24.5]}
CAMERA, LASER, CLOUD = (REGISTRY.sensor_type(n) for n in ("camera", "lrf2d", "lrf3d"))
CAM = CAMERA.config.model_validate(
    {"type": "camera", "topic": "/cam/image_raw", **LENS, "distortion": [-0.2, 0.1, 1e-3, 2e-3]}
)
T_LIDAR_CAM = se3.exp(np.array([1.2, -1.1, 1.3, 0.3, -0.2, 0.1]))
T_LIDAR_FRONT = se3.exp(np.array([0.02, -0.01, 1.5, 0.5, 0.4, -0.6]))
T_BASE_LIDAR = se3.exp(np.array([0.0, 0.1, -0.7, 0.1, 0.2, 1.4]))
CALIBRATION = Calibration(
    "lidar",
    {
        "lidar": SensorResult("lidar", np.eye(4)),
        "cam": SensorResult("lidar", T_LIDAR_CAM),
        "front": SensorResult("lidar", T_LIDAR_FRONT),
    },
)
BASE = PoseConfig(
    parent="base_link",
    translation_m=tuple(T_BASE_LIDAR[:3, 3].tolist()),
    rpy_deg=tuple(np.degrees(se3.rpy_from_rotation(T_BASE_LIDAR[:3, :3])).tolist()),
)
SENSORS = {
    "lidar": CLOUD.config(type="lrf3d"), "cam": CAM, "front": LASER.config(type="lrf2d"),
}  # fmt: skip
RIG = Rig("robot", "lidar", {}, SENSORS, base=BASE)

Record = Callable[..., Path]


@pytest.fixture
def record(tmp_path: Path) -> Record:
    """A recording of a camera, a 2D and a 3D laser; what it says of them can be left out."""

    def run(*, info: bool = True, static: bool = True, suffix: str = ".mcap") -> Path:
        image = CAMERA.encode(np.zeros((48, 64), np.uint8), CAM, 5, "cam_optical")  # type: ignore[misc]
        scan = ros.make(
            "sensor_msgs/msg/LaserScan", header=ros.header(5, "/front_link"),
            angle_min=-np.pi / 2, angle_max=np.pi / 2, angle_increment=np.pi / 360,
            ranges=np.ones(361),
        )  # fmt: skip
        points = ros.make("sensor_msgs/msg/PointCloud2", header=ros.header(5, "velodyne"))
        frames = {
            "velodyne": ("base_link", T_BASE_LIDAR),
            "front_link": ("velodyne", T_LIDAR_FRONT),
            "mast": ("base_link", se3.exp(np.array([0, 0, 0, 0, 0, 1.0]))),
        }
        T_base_cam = T_BASE_LIDAR @ T_LIDAR_CAM
        frames["cam_optical"] = ("mast", se3.inverse(frames["mast"][1]) @ T_base_cam)
        path = tmp_path / f"drive{suffix}"
        with RecordingWriter(path) as writer:
            for topic, message in (
                ("/cam/image_raw", image), ("/front/scan", scan), ("/lidar/points", points),
            ):  # fmt: skip
                writer.write(topic, message.__msgtype__, message, 5)
            if info:
                extra = CAMERA.extra_messages(CAM, 5, "cam_optical")  # type: ignore[misc]
                for name, (kind, message) in extra.items():
                    writer.write(f"/cam/{name}", kind, message, 5)
            if static:
                writer.write("/tf_static", ros.TF_TYPE, ros.tf_static(frames), 5)
        return path

    return run


def _load(text: str, tmp_path: Path) -> Rig:
    path = tmp_path / "written.yaml"
    path.write_text(text)
    return rigcal.load_rig(path, REGISTRY)


def _check_poses(rig: Rig, atol: float = 1e-9) -> None:
    found = T_root_sensors(rig)
    np.testing.assert_allclose(found["cam"], T_LIDAR_CAM, rtol=0, atol=atol)
    np.testing.assert_allclose(found["front"], T_LIDAR_FRONT, rtol=0, atol=atol)


@pytest.mark.parametrize("suffix", [".mcap", ".bag"])
def test_a_recording_tells_sensors_lenses_and_poses(
    record: Record, tmp_path: Path, suffix: str
) -> None:
    text = rigcal.propose_rig(record(suffix=suffix), REGISTRY)
    rig = _load(text, tmp_path)
    kinds = {name: (config.type, config.topic) for name, config in rig.sensors.items()}
    assert kinds == {
        "cam": ("camera", "/cam/image_raw"),
        "front": ("lrf2d", "/front/scan"),
        "lidar": ("lrf3d", "/lidar/points"),
    }
    assert (rig.root, rig.name) == ("lidar", "drive")
    cam, front = (rig.sensors[name].model_dump() for name in ("cam", "front"))
    assert {key: list(cam[key]) for key in ("focal_px", "principal_px")} == {
        key: LENS[key] for key in ("focal_px", "principal_px")
    }
    assert (cam["width_px"], cam["height_px"], cam["model"]) == (64, 48, "pinhole")
    assert cam["distortion"] == (-0.2, 0.1, 1e-3, 2e-3, 0.0)
    assert front["angle_step_deg"] == pytest.approx(0.5)
    assert (front["angle_min_deg"], front["angle_max_deg"]) == (-90.0, 90.0)
    _check_poses(rig)
    assert rig.base is not None
    assert rig.base.parent == "base_link"
    np.testing.assert_allclose(rig.base.T_parent_sensor, T_BASE_LIDAR, rtol=0, atol=1e-9)
    assert "FILL IN the board" in text
    assert "from /tf_static" in text


@pytest.mark.parametrize("form", ["urdf", "opencv", "kalibr", "camera-info"])
def test_what_was_exported_comes_back(form: str, record: Record, tmp_path: Path) -> None:
    """Of each format what it holds: the lens, the poses, or both."""
    paths = rigcal.write_export(tmp_path / "cam.yaml", CALIBRATION, REGISTRY, form, RIG)
    recording = record(info=form == "urdf", static=form == "camera-info")
    rig = _load(rigcal.propose_rig(recording, REGISTRY, [(paths[0], None)]), tmp_path)
    cam = rig.sensors["cam"].model_dump()
    assert list(cam["focal_px"]) == LENS["focal_px"]
    assert cam["distortion"][:4] == (-0.2, 0.1, 1e-3, 2e-3)
    if form == "urdf":
        _check_poses(rig)
        assert rig.base is not None
        np.testing.assert_allclose(rig.base.T_parent_sensor, T_BASE_LIDAR, rtol=0, atol=1e-9)
    elif form == "opencv":
        np.testing.assert_allclose(T_of(rig, "cam"), T_LIDAR_CAM, rtol=0, atol=1e-9)
    elif form == "camera-info":
        _check_poses(rig)


def T_of(rig: Rig, name: str) -> Any:
    pose = rig.sensors[name].pose
    assert pose is not None
    assert pose.parent == rig.root
    return pose.T_parent_sensor


def test_a_camera_without_lens_waits_in_comments(record: Record, tmp_path: Path) -> None:
    text = rigcal.propose_rig(record(info=False), REGISTRY)
    rig = _load(text, tmp_path)
    assert list(rig.sensors) == ["front", "lidar"]
    assert "FILL IN, then remove the marks: key 'focal_px' is missing; key 'principal_px'" in text
    assert "  # cam:  # 1 x sensor_msgs/msg/Image\n  #   type: camera\n" in text
    filled = text.replace("  #   type: camera", "  #   focal_px: [9, 9]\n  #   type: camera")
    filled = filled.replace("  #   type: camera", "  #   principal_px: [9, 9]\n  #   type: camera")
    rest = (
        filled[filled.index("sensors:") :].replace("  # cam:", "  cam:").replace("  #   ", "    ")
    )
    again = _load(filled[: filled.index("sensors:")] + rest, tmp_path)
    assert set(again.sensors) == {"cam", "front", "lidar"}


def test_a_recording_of_a_camera_without_lens_says_what_to_give(tmp_path: Path) -> None:
    image = CAMERA.encode(np.zeros((48, 64), np.uint8), CAM, 5, "eye")  # type: ignore[misc]
    with pytest.raises(InputError) as caught:
        _proposed(tmp_path / "a.mcap", {"/cam/image_raw": image}, tmp_path)
    assert str(caught.value) == (
        f"{tmp_path / 'a.mcap'}: no sensor can be described\n"
        "  cam: key 'focal_px' is missing; key 'principal_px' is missing\n"
        "give what is missing in a file of another tool: --from NAME=FILE"
    )


def test_a_lens_that_cannot_be_used_is_told_beside_its_camera(tmp_path: Path) -> None:
    image = CAMERA.encode(np.zeros((48, 64), np.uint8), CAM, 5, "eye")  # type: ignore[misc]
    points = ros.make("sensor_msgs/msg/PointCloud2", header=ros.header(5, "velodyne"))
    info = _info(60.0)
    info.distortion_model = "omni"
    topics = {"/cam/image_raw": image, "/cam/camera_info": info, "/lidar/points": points}
    rig, text = _proposed(tmp_path / "a.mcap", topics, tmp_path)
    assert list(rig.sensors) == ["lidar"]
    assert "  # /cam/camera_info: lens model 'omni' is not one that rigcal has" in text


def test_a_file_is_given_to_the_sensor_that_is_named(record: Record, tmp_path: Path) -> None:
    other = tmp_path / "left_intrinsics.yml"
    files = rigcal.export(CALIBRATION, REGISTRY, "opencv", RIG)
    assert not isinstance(files, str)
    other.write_text(files["cam.yaml"].replace("root: lidar\n", ""))
    recording = record(info=False)
    with pytest.raises(ConfigError, match="say whose it is: --from NAME="):
        rigcal.propose_rig(recording, REGISTRY, [(other, None)])
    with pytest.raises(ConfigError, match="describes a camera, and 'front'"):
        rigcal.propose_rig(recording, REGISTRY, [(other, "front")])
    with pytest.raises(ConfigError, match="no sensor 'cams', did you mean 'cam'"):
        rigcal.propose_rig(recording, REGISTRY, [(other, "cams")])
    poses = rigcal.write_export(tmp_path / "robot.urdf", CALIBRATION, REGISTRY, "urdf", RIG)[0]
    with pytest.raises(ConfigError, match=r"describes 0 sensors, so it cannot .* that of 'cam'"):
        rigcal.propose_rig(recording, REGISTRY, [(poses, "cam")])
    rig = _load(rigcal.propose_rig(recording, REGISTRY, [(other, "cam")]), tmp_path)
    assert list(rig.sensors["cam"].model_dump()["focal_px"]) == LENS["focal_px"]


def test_the_command_writes_once_and_tells_programs(
    record: Record, tmp_path: Path, command: Any
) -> None:
    out = tmp_path / "rig.yaml"
    run = partial(command, "init", record(), "--out", out)
    code, text, _ = run("--json", "--root", "cam")
    assert code == 0
    assert json.loads(text) == {
        "rig": str(out), "root": "cam", "sensors": ["cam", "front", "lidar"],
    }  # fmt: skip
    rig = rigcal.load_rig(out, REGISTRY)
    T = T_root_sensors(rig)["front"]
    np.testing.assert_allclose(T, se3.inverse(T_LIDAR_CAM) @ T_LIDAR_FRONT, rtol=0, atol=1e-9)
    code, _, error = run()
    assert code == 2
    assert "is there already" in error
    out.unlink()
    code, _, error = run("--root", "lidr")
    assert code == 2
    assert "no sensor 'lidr' that could be the root, did you mean 'lidar'?" in error
    assert not out.exists()


def test_the_command_takes_files_and_says_what_to_do_next(
    record: Record, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    lens = rigcal.write_export(tmp_path / "lens.yaml", CALIBRATION, REGISTRY, "opencv", RIG)[0]
    urdf = rigcal.write_export(tmp_path / "a=b.urdf", CALIBRATION, REGISTRY, "urdf", RIG)[0]
    recording = record(info=False, static=False)
    sources = ("--from", f"cam={lens}", "--from", urdf.name)
    code, text, _ = command("init", recording, "--out", "cart.yaml", *sources)
    assert code == 0
    assert text.startswith("cart.yaml: cam, front, lidar (root lidar)\nEdit it where it says FILL")
    _check_poses(rigcal.load_rig("cart.yaml", REGISTRY))
    head = Path("cart.yaml").read_text().splitlines()[:2]
    assert head[1] == "#     rigcal calibrate cart.yaml drive.mcap --out result"
    assert command("init", recording, "--out", "b.yaml", *sources, "--quiet") == (0, "", "")
    code, _, error = command("init", recording, "--out", "c.yaml", "--from", "cam=")
    assert (code, error) == (2, "rigcal: --from cam=: expected a file after the '='\n")


def _info(focal_px: float) -> Any:
    config = CAM.model_copy(update={"focal_px": (focal_px, focal_px)})
    return CAMERA.extra_messages(config, 5, "eye")["camera_info"][1]  # type: ignore[misc]


def _proposed(path: Path, topics: dict[str, Any], tmp_path: Path) -> tuple[Rig, str]:
    with RecordingWriter(path) as writer:
        for topic, message in topics.items():
            writer.write(topic, message.__msgtype__, message, 5)
    text = rigcal.propose_rig(path, REGISTRY)
    return _load(text, tmp_path), text


def test_two_cameras_of_one_namespace_get_their_own_lens(tmp_path: Path) -> None:
    image = CAMERA.encode(np.zeros((48, 64), np.uint8), CAM, 5, "eye")  # type: ignore[misc]
    topics = {"/rig/left_image": image, "/rig/right_image": image}
    infos = {"/rig/right_camera_info": _info(60.0), "/rig/left_camera_info": _info(50.0)}
    rig, text = _proposed(tmp_path / "a.mcap", topics | infos, tmp_path)
    focal = {name: config.model_dump()["focal_px"] for name, config in rig.sensors.items()}
    assert focal == {"rig_left_image": (50.0, 50.0), "rig_right_image": (60.0, 60.0)}
    assert "# described by /rig/left_camera_info" in text
    del infos["/rig/right_camera_info"]
    rig, text = _proposed(tmp_path / "b.mcap", topics | infos, tmp_path)
    assert list(rig.sensors) == ["rig_left_image"]
    assert "# rig_right_image:" in text


def test_two_images_of_one_camera_share_its_lens(tmp_path: Path) -> None:
    image = CAMERA.encode(np.zeros((48, 64), np.uint8), CAM, 5, "eye")  # type: ignore[misc]
    topics = {"/cam/color": image, "/cam/image_raw": image, "/cam/camera_info": _info(60.0)}
    rig, _ = _proposed(tmp_path / "a.mcap", topics, tmp_path)
    assert set(rig.sensors) == {"cam_color", "cam_image_raw"}


def test_a_lens_that_could_be_of_either_is_not_guessed(tmp_path: Path) -> None:
    image = CAMERA.encode(np.zeros((48, 64), np.uint8), CAM, 5, "eye")  # type: ignore[misc]
    points = ros.make("sensor_msgs/msg/PointCloud2", header=ros.header(5, "velodyne"))
    infos = {"/cam/info_a": _info(60.0), "/cam/info_b": _info(50.0)}
    topics = {"/cam/main": image, "/velodyne_points": points, **infos}
    rig, text = _proposed(tmp_path / "a.mcap", topics, tmp_path)
    assert list(rig.sensors) == ["velodyne_points"]
    assert "several topics may describe it, none is used: /cam/info_a, /cam/info_b" in text


def test_a_compressed_copy_is_no_second_camera(tmp_path: Path) -> None:
    image = CAMERA.encode(np.zeros((48, 64), np.uint8), CAM, 5, "eye")  # type: ignore[misc]
    effects = CAMERA.effects.model_validate({"jpeg_quality": 90})
    small = CAMERA.transport(image, effects)  # type: ignore[misc]
    both = {"/cam/image/compressed": small, "/cam/image": image, "/cam/camera_info": _info(60.0)}
    rig, _ = _proposed(tmp_path / "both.mcap", both, tmp_path)
    assert {name: c.topic for name, c in rig.sensors.items()} == {"cam": "/cam/image"}
    del both["/cam/image"]
    rig, _ = _proposed(tmp_path / "one.mcap", both, tmp_path)
    assert {name: c.topic for name, c in rig.sensors.items()} == {"cam": "/cam/image/compressed"}


def test_an_importer_that_fails_is_named(tmp_path: Path) -> None:
    def rigcal_importers() -> list[Importer]:
        return [Importer("acme", "for a test", lambda text, stem: 1 / 0)]  # type: ignore[arg-type, return-value]

    path = tmp_path / "a.txt"
    path.write_text("a")
    registry = Registry([SimpleNamespace(rigcal_importers=hookimpl(rigcal_importers))])
    with pytest.raises(PluginError, match=r"importer 'acme' failed on .*a\.txt with ZeroDiv"):
        import_file(path, registry)


def test_a_folder_of_files_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"")
    with pytest.raises(InputError, match="a folder of files has none; write its rig by hand"):
        rigcal.propose_rig(tmp_path, REGISTRY)


def test_a_recording_without_sensors_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "empty.mcap"
    with RecordingWriter(path) as writer:
        writer.write("/tf_static", ros.TF_TYPE, ros.tf_static({}), 5)
    with pytest.raises(InputError, match=r"no topic is of a known sensor; it holds:\n  /tf_static"):
        rigcal.propose_rig(path, REGISTRY)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<robot name='a'><joint", "not valid XML"),
        (
            "<robot><joint name='j' type='fixed'><parent link='a'/><child link='b'/>"
            "<origin xyz='1 2'/></joint></robot>",
            "joint 'j': xyz is '1 2', expected three numbers",
        ),
        ("cam0: {intrinsics: [1, 2]}", "cam0.intrinsics: expected 4 numbers"),
        ("cam0: {intrinsics: [1, 2, 3, 4], camera_model: omni}", "camera_model is 'omni'"),
        (
            yaml.safe_dump({"image_width": 4, "camera_matrix": {"data": [1.0] * 9}}),
            "the camera matrix has a skew of 1",
        ),
        (
            "{image_width: 4, camera_matrix: [1, 2]}",
            "has shape (2,), expected 3 x 3 finite numbers",
        ),
        ("{image_width: 4, camera_matrix: [a, b]}", "camera_matrix: found ['a', 'b']; write its"),
        ("{image_width: wide, camera_matrix: []}", "image_width: found 'wide'; write the number"),
        ("%YAML:1.0\n---\nM1: !!opencv-matrix\n   rows: 1\n", "file"),
        ("a: b", "of no format that can be imported"),
    ],
)
def test_a_file_that_cannot_be_used_is_named(
    text: str, message: str, record: Record, tmp_path: Path
) -> None:
    path = tmp_path / "file.txt"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        rigcal.propose_rig(record(), REGISTRY, [(path, None)])
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)
