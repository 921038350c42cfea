"""What programs of ROS and Autoware read from an export is the calibration, to 1e-9."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

import rigcal
from rigcal.calibration import Calibration, SensorResult
from rigcal.errors import ConfigError, InputError
from rigcal.plugin import PoseConfig, Registry, Rig, SensorConfig

Frames = dict[str, tuple[str, Any]]
"""Parent and pose in it of every frame, as a file has them."""


class Eye(SensorConfig, frozen=True):
    optical: ClassVar[bool] = True
    type: Literal["eye"] = "eye"


class Ear(SensorConfig, frozen=True):
    type: Literal["ear"] = "ear"


def _pose(rpy_deg: list[float], t: list[float]) -> Any:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", rpy_deg, degrees=True).as_matrix()
    T[:3, 3] = t
    return T


# Straight up and straight down are where roll and yaw of a frame can no longer be told apart.
UP = np.array([[0, 0, -1, 0.2], [0, 1, 0, 0.3], [1, 0, 0, 0.4], [0, 0, 0, 1.0]])
LOCKED = _pose([20, 90, 50], [1, 2, 3])
NEARLY = _pose([20, 90 - 1e-6, 50], [-1, 2, 3])
POSES = {
    "lidar": np.eye(4),
    "cam-0": _pose([-91, 3, -88], [0.1, -0.2, 0.3]),
    "cam1": _pose([-100, 20, 170], [-0.5, 0.2, 1e-7]),
    "front": _pose([1, -2, 179.9], [1.2, 0.1, -0.3]),
    "up": UP,
    "locked": LOCKED,
    "nearly": NEARLY,
}
SENSORS = {name: Eye(type="eye") if "cam" in name else Ear(type="ear") for name in POSES}
BASE = PoseConfig(parent="base_link", translation_m=(0.5, 0.0, 1.5), rpy_deg=(2.0, -4.0, 90.0))
T_BASE_LIDAR = _pose([2, -4, 90], [0.5, 0, 1.5])
# Columns: the axes of the frame with x forward, as the optical frame sees them.
T_OPTICAL_BODY = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])


def _calibration(root: str) -> Calibration:
    T_root = np.linalg.inv(POSES[root])
    results = {name: SensorResult(root, T_root @ T) for name, T in POSES.items()}
    # One sensor hangs from another: files show it in the root all the same.
    results["up"] = SensorResult("front", np.linalg.inv(POSES["front"]) @ POSES["up"])
    results[root] = SensorResult(root, np.eye(4))
    return Calibration(root, results)


def _rig(root: str, *, base: bool) -> Rig:
    own = None
    if base:
        T = T_BASE_LIDAR @ POSES[root]
        x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat().tolist()
        content = {"parent": "base_link", "translation_m": tuple(T[:3, 3].tolist())}
        own = PoseConfig.model_validate(content | {"rotation": {"x": x, "y": y, "z": z, "w": w}})
    return Rig("my rig", root, {}, SENSORS, base=own)


def _export(form: str, rig: Rig) -> Any:
    return rigcal.export(_calibration(rig.root), Registry(), form, rig)


def _rpy(values: Any) -> Any:
    return Rotation.from_euler("xyz", values).as_matrix()


def _matrix(xyz: Any, R: Any) -> Any:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, xyz
    return T


def _in_top(frames: Frames, name: str) -> Any:
    """The pose of a frame in the uppermost one, composed as tf does it."""
    T = np.eye(4)
    while name in frames:
        name, step = frames[name][0], frames[name][1] @ T
        T = step
    return T


def _from_urdf(text: str) -> Frames:
    from urdf_parser_py.urdf import URDF

    robot = URDF.from_xml_string(text.partition("?>")[2].encode())
    assert {joint.type for joint in robot.joints} == {"fixed"}
    links = {link.name for link in robot.links}
    frames = {j.child: (j.parent, _matrix(j.origin.xyz, _rpy(j.origin.rpy))) for j in robot.joints}
    assert links == {*frames, robot.get_root()}
    return frames


def _from_xacro(text: str, tmp_path: Path, arguments: str) -> Frames:
    import xacro

    (tmp_path / "sensors.xacro").write_text(text)
    (tmp_path / "robot.xacro").write_text(
        '<robot name="mine" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        f'<xacro:include filename="{tmp_path}/sensors.xacro"/>'
        f'<link name="base_link"/><xacro:sensors_of_my_rig {arguments}/></robot>'
    )
    return _from_urdf(xacro.process_file(str(tmp_path / "robot.xacro")).toxml())


def _from_launch(text: str) -> Frames:
    frames = {}
    for node in ET.fromstring(text).iter("node"):
        assert node.attrib["exec"] == "static_transform_publisher"
        words = node.attrib["args"].split()
        given = dict(zip(words[::2], words[1::2], strict=True))
        q = [float(given[f"--q{axis}"]) for axis in "xyzw"]
        t = [float(given[f"--{axis}"]) for axis in "xyz"]
        frames[given["--child-frame-id"]] = (
            given["--frame-id"], _matrix(t, Rotation.from_quat(q).as_matrix())
        )  # fmt: skip
    return frames


def _from_tf(text: str) -> Frames:
    frames = {}
    for one in yaml.safe_load(text)["transforms"]:
        t, q = one["transform"]["translation"], one["transform"]["rotation"]
        R = Rotation.from_quat([q[axis] for axis in "xyzw"]).as_matrix()
        parent = one["header"]["frame_id"]
        frames[one["child_frame_id"]] = (parent, _matrix([t[axis] for axis in "xyz"], R))
    return frames


READERS: dict[str, Callable[[str], Frames]] = {
    "urdf": _from_urdf, "ros2-launch": _from_launch, "tf-static": _from_tf,
}  # fmt: skip


def _check(frames: Frames, root: str, T_top_lidar: Any) -> None:
    """Own frames of sensors stand where the calibration has them, and the others by REP 103."""
    for name, T_lidar_s in POSES.items():
        own = f"{name}_optical_frame" if "cam" in name else name
        T_top_s = T_top_lidar @ T_lidar_s
        np.testing.assert_allclose(_in_top(frames, own), T_top_s, rtol=0, atol=1e-9)
        if own != name:
            assert frames[own][0] == name
            body = T_top_s @ T_OPTICAL_BODY
            np.testing.assert_allclose(_in_top(frames, name), body, rtol=0, atol=1e-9)
    assert {parent for name, (parent, _) in frames.items() if name in POSES} <= {root, "base_link"}


@pytest.mark.parametrize("form", READERS)
@pytest.mark.parametrize("root", ["lidar", "cam1"])
def test_frames_hang_from_the_robot(form: str, root: str) -> None:
    frames = READERS[form](_export(form, _rig(root, base=True)))
    assert frames[root][0] == "base_link"
    assert "base_link" not in frames
    _check(frames, root, T_BASE_LIDAR)


@pytest.mark.parametrize("form", READERS)
@pytest.mark.parametrize("root", ["lidar", "cam1"])
def test_without_a_base_the_root_is_uppermost(form: str, root: str) -> None:
    text = _export(form, _rig(root, base=False))
    frames = READERS[form](text)
    assert root not in frames
    T_root_lidar = np.linalg.inv(POSES[root])
    T_body_root = np.linalg.inv(T_OPTICAL_BODY) if root == "cam1" else np.eye(4)
    _check(frames, root, T_body_root @ T_root_lidar)
    assert "`base: {parent: base_link," in text


@pytest.mark.parametrize("root", ["lidar", "cam1"])
def test_xacro_macro_adds_the_sensors_to_a_robot(root: str, tmp_path: Path) -> None:
    frames = _from_xacro(_export("xacro", _rig(root, base=True)), tmp_path, "")
    _check(frames, root, T_BASE_LIDAR)


def test_xacro_macro_without_a_base_wants_the_pose(tmp_path: Path) -> None:
    text = _export("xacro", _rig("lidar", base=False))
    with pytest.raises(Exception, match="xyz"):
        _from_xacro(text, tmp_path, 'parent="base_link"')
    angles = " ".join(map(str, np.radians([2.0, -4.0, 90.0])))
    use = f'parent="base_link" xyz="0.5 0 1.5" rpy="{angles}"'
    _check(_from_xacro(text, tmp_path, use), "lidar", T_BASE_LIDAR)


@pytest.mark.parametrize("root", ["lidar", "cam1"])
def test_autoware_has_the_kit_in_the_robot_and_the_sensors_in_the_kit(root: str) -> None:
    def frames(text: str) -> Frames:
        return {
            child: (parent, _matrix([p[k] for k in "xyz"], _rpy([p["roll"], p["pitch"], p["yaw"]])))
            for parent, children in yaml.safe_load(text).items()
            for child, p in children.items()
        }

    texts: Mapping[str, str] = _export("autoware", _rig(root, base=True))
    kit = frames(texts["sensor_kit_calibration.yaml"])
    robot = frames(texts["sensors_calibration.yaml"])
    assert {parent for parent, _ in kit.values()} == {"sensor_kit_base_link"} == set(robot)
    assert next(iter(kit)) == root
    T_base_kit = robot["sensor_kit_base_link"][1]
    for name, T_lidar_s in POSES.items():
        T = T_BASE_LIDAR @ T_lidar_s @ (T_OPTICAL_BODY if "cam" in name else np.eye(4))
        np.testing.assert_allclose(T_base_kit @ kit[name][1], T, rtol=0, atol=1e-9)
    assert set(_export("autoware", _rig(root, base=False))) == {"sensor_kit_calibration.yaml"}


@pytest.mark.parametrize("form", ["urdf", "xacro", "ros2-launch", "tf-static", "autoware"])
def test_every_file_says_its_directions(form: str) -> None:
    texts = _export(form, _rig("lidar", base=True))
    for text in [texts] if isinstance(texts, str) else texts.values():
        assert "p_parent = R p_child + t" in text
        assert "NAME_optical_frame" in text
        order = "Quaternions" if form in ("ros2-launch", "tf-static") else "R = Rz Ry Rx"
        assert order in text


def test_files_of_a_rig_without_cameras_speak_of_no_optical_frames() -> None:
    rig = _rig("lidar", base=True)
    lasers = {name: POSES[name] for name in ("lidar", "front")}
    calibration = Calibration("lidar", {n: SensorResult("lidar", T) for n, T in lasers.items()})
    text = rigcal.export(calibration, Registry(), "urdf", rig)
    assert "optical" not in text
    assert "front" in text


def test_two_frames_of_one_name_are_refused() -> None:
    rig = _rig("lidar", base=True)
    assert rig.base is not None
    clash = replace(rig, base=rig.base.model_copy(update={"parent": "cam1_optical_frame"}))
    with pytest.raises(InputError, match="two frames would be called 'cam1_optical_frame'"):
        _export("urdf", clash)


@pytest.mark.parametrize(
    ("base", "message"),
    [
        ("{parent: a}", "base.parent: 'a' is a sensor, expected the name of a frame of the robot"),
        ("{parent: base link}", "base.parent: name 'base link': use letters"),
        ("{parent: base_link, rpy: [0, 0, 0]}", "base.rpy: unknown key, did you mean 'rpy_deg'?"),
    ],
)
def test_wrong_base_is_told(base: str, message: str) -> None:
    registry = Registry.from_entry_points()
    text = (
        "{version: 1, root: a, targets: {t: {type: checkerboard, columns: 4, rows: 3, "
        f"square_size_m: 0.1}}}}, sensors: {{a: {{type: lrf3d, topic: /a}}}}, base: {base}}}"
    )
    with pytest.raises(ConfigError) as caught:
        rigcal.parse_rig(yaml.safe_load(text), registry)
    assert message in str(caught.value)
