"""Frames from a URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from rigcal.errors import ConfigError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.importing.importer import Imported, Importer


def read_urdf(text: str, stem: str) -> Imported | None:
    """The links that fixed joints hold; where a joint moves, what hangs from it is a tree apart.

    Source of the format: wiki.ros.org/urdf/XML/joint.
    """
    if "<robot" not in text:
        return None
    try:
        robot = ET.fromstring(text)
    except ET.ParseError as error:
        raise ConfigError(f"not valid XML: {error}") from error
    if robot.tag != "robot":
        return None
    if "http://www.ros.org/wiki/xacro" in text and robot.find(".//{*}macro") is not None:
        raise ConfigError("it has xacro macros; expand them first: xacro FILE > robot.urdf")
    frames = {}
    for joint in robot.iter("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if joint.get("type") == "fixed" and parent is not None and child is not None:
            name = joint.get("name", "?")
            frames[child.get("link", "")] = (parent.get("link", ""), _origin(joint, name))
    return Imported(frames=frames)


def _origin(joint: ET.Element, name: str) -> Array:
    origin = joint.find("origin")
    if origin is None:
        return np.eye(4)
    xyz, rpy = (_three(origin.get(key, "0 0 0"), f"joint '{name}': {key}") for key in _KEYS)
    return se3.transform(se3.rotation_from_rpy(rpy), xyz)


_KEYS = ("xyz", "rpy")


def _three(words: str, where: str) -> Array:
    try:
        values = np.array([float(word) for word in words.split()])
    except ValueError:
        values = np.empty(0)
    if values.shape != (3,) or not np.isfinite(values).all():
        raise ConfigError(f"{where} is '{words}', expected three numbers")
    return values


URDF_FILE = Importer("urdf", "URDF: frames of fixed joints", read_urdf)
