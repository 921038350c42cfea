"""URDF: the sensors as links with fixed joints, complete or as a xacro macro for a robot's own."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence

from rigcal.calibration import Calibration
from rigcal.exporting.exporter import Exporter
from rigcal.exporting.frames import Frame, base_frame, notes, sensor_frames
from rigcal.exporting.text import xml_comment, xml_document
from rigcal.rig import Rig

_ANGLES = "rpy: roll, pitch, yaw about the fixed axes x, y, z of the parent: R = Rz Ry Rx."


def urdf_text(calibration: Calibration, rig: Rig | None) -> str:
    """A robot of nothing but the sensors; its base link is that of the rig's `base`, or the root.

    Source of the format: wiki.ros.org/urdf/XML.
    """
    assert rig is not None  # the format needs it
    robot = ET.Element("robot", name=rig.name)
    xml_comment(robot, [*notes(calibration, rig), _ANGLES])
    ET.SubElement(robot, "link", name=rig.base.parent if rig.base else calibration.root)
    _links(robot, sensor_frames(calibration, rig))
    return xml_document(robot)


def xacro_text(calibration: Calibration, rig: Rig | None) -> str:
    """A macro that hangs the sensors from a link of a robot's own xacro file.

    The pose of the root's frame in it is that of the rig's `base`; without one it must be given.
    """
    assert rig is not None  # the format needs it
    robot = ET.Element("robot", {"xmlns:xacro": "http://www.ros.org/wiki/xacro"})
    name = f"sensors_of_{re.sub('[^A-Za-z0-9_]', '_', rig.name)}"
    parameters, given = "parent xyz rpy", "parent='base_link' xyz='...' rpy='...'"
    for frame in base_frame(calibration, rig):
        xyz, rpy = _words(frame.translation), _words(frame.rpy)
        parameters, given = f"parent:={frame.parent} xyz:='{xyz}' rpy:='{rpy}'", ""
    use = [
        "For use in a robot's xacro file, after <xacro:include filename='THIS FILE'/>:",
        f"<xacro:{name} {given}/>".replace(" />", "/>"),
        f"xyz and rpy are the pose of the root sensor's frame '{calibration.root}' in the parent.",
    ]
    xml_comment(robot, [*notes(calibration, rig), _ANGLES, *use])
    macro = ET.SubElement(robot, "xacro:macro", name=name, params=parameters)
    _link(macro, calibration.root, "${parent}", "${xyz}", "${rpy}")
    _links(macro, (f for f in sensor_frames(calibration, rig) if f.name != calibration.root))
    return xml_document(robot)


def _links(element: ET.Element, frames: Iterable[Frame]) -> None:
    for frame in frames:
        _link(element, frame.name, frame.parent, _words(frame.translation), _words(frame.rpy))


def _link(element: ET.Element, name: str, parent: str, xyz: str, rpy: str) -> None:
    ET.SubElement(element, "link", name=name)
    joint = ET.SubElement(element, "joint", name=f"{name}_joint", type="fixed")
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=name)
    ET.SubElement(joint, "origin", xyz=xyz, rpy=rpy)


def _words(values: Sequence[float]) -> str:
    return " ".join(map(repr, values))


URDF = Exporter("urdf", "URDF: links of the sensors with fixed joints", urdf_text, needs_rig=True)
XACRO = Exporter("xacro", "xacro: a macro that adds the sensors to a robot", xacro_text, True)
