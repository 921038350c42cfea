"""Frames from a URDF, and files that cannot be read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rigcal import Registry
from rigcal.errors import ConfigError
from rigcal.geometry.se3 import Array
from rigcal.importing import import_file

ROBOT = """\
<?xml version="1.0"?>
<robot name="cart">
  <link name="base"/>
  <joint name="mast_joint" type="fixed">
    <parent link="base"/><child link="mast"/>
    <origin xyz="0.1 0 1.5" rpy="0 0 1.5707963267948966"/>
  </joint>
  <joint name="eye_joint" type="fixed"><parent link="mast"/><child link="eye"/></joint>
  <joint name="pan" type="revolute">
    <parent link="mast"/><child link="head"/><origin xyz="0 0 1"/>
  </joint>
  <transmission name="t"><joint name="pan"/></transmission>
</robot>
"""
JOINT = '<joint name="j" type="fixed"><parent link="a"/><child link="b"/>{}</joint>'


def _import(tmp_path: Path, text: str) -> dict[str, tuple[str, Array]]:
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    return dict(import_file(path, Registry()).frames)


def test_links_that_fixed_joints_hold_have_poses_and_those_that_move_have_none(
    tmp_path: Path,
) -> None:
    frames = _import(tmp_path, ROBOT)
    assert {name: parent for name, (parent, _) in frames.items()} == {"mast": "base", "eye": "mast"}
    T_base_mast, T_mast_eye = frames["mast"][1], frames["eye"][1]
    expected = [[0, -1, 0, 0.1], [1, 0, 0, 0], [0, 0, 1, 1.5], [0, 0, 0, 1]]
    np.testing.assert_allclose(T_base_mast, expected, atol=1e-15)
    np.testing.assert_array_equal(T_mast_eye, np.eye(4))  # what <origin> is where it is left out


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            '<robot xmlns:x="http://www.ros.org/wiki/xacro"><x:macro name="wheel"/></robot>',
            "it has xacro macros; expand them first: xacro FILE > robot.urdf",
        ),
        (
            "<robot>" + JOINT.format('<origin xyz="0 ${h} 1"/>') + "</robot>",
            "joint 'j': xyz is '0 ${h} 1', expected three numbers",
        ),
        (
            "<robot>" + JOINT.format('<origin rpy="0 nan 1"/>') + "</robot>",
            "joint 'j': rpy is '0 nan 1', expected three numbers",
        ),
        ("<launch><robot/></launch>", "it is of no format that can be imported (known: urdf)"),
    ],
)
def test_what_is_no_urdf_that_can_be_used_is_told(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        _import(tmp_path, text)
    assert str(caught.value) == f"{tmp_path / 'robot.urdf'}: {message}"


def test_a_file_that_cannot_be_read_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.urdf: cannot be read: No such file"):
        import_file(tmp_path / "none.urdf", Registry())
    (tmp_path / "a.bin").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match=r"a\.bin: cannot be read: it is not UTF-8 text"):
        import_file(tmp_path / "a.bin", Registry())
