"""ROS messages without ROS: the types of ROS 2 Humble, and those that a plugin defines."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.interfaces import Nodetype

from rigcal.errors import PluginError, RecordingError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.recording.message import STANDARD, Definitions

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

TF_TYPE = "tf2_msgs/msg/TFMessage"
_TEXT = ("string", "wstring")
_DTYPES = {"bool": "bool", "byte": "uint8", "char": "uint8", "octet": "uint8"}


class DefinedMessage(SimpleNamespace):
    """A message whose type a plugin defines; like a bag it carries the `__definitions__`.

    (The classes that rosbags makes of definitions cannot be sent to another process.)
    """


def typestore(definitions: Definitions = STANDARD) -> Typestore:
    """The message types of ROS 2 Humble and those defined; PluginError for a bad definition."""
    return _typestore("ROS2_HUMBLE", tuple(sorted(definitions.items())))


def ros1_typestore(definitions: Definitions = STANDARD) -> Typestore:
    """The message types of ROS 1 Noetic and those defined; PluginError for a bad definition."""
    # The one type of ours that rosbags' Noetic store lacks.
    lacking = {TF_TYPE: "geometry_msgs/TransformStamped[] transforms"}
    return _typestore("ROS1_NOETIC", tuple(sorted((lacking | dict(definitions)).items())))


@cache
def _typestore(standard: str, definitions: tuple[tuple[str, str], ...]) -> Typestore:
    from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

    store = get_typestore(Stores[standard])
    for name, text in definitions:
        try:
            store.register(get_types_from_msg(text, name))
        except TypesysError as error:
            raise PluginError(
                f"the definition of message type '{name}' cannot be used: {error}; expected the "
                "text of its .msg file"
            ) from error
    return store


def definitions_of(message: object) -> Definitions:
    """What the message's type is defined by; empty for a type of ROS."""
    found: Definitions = getattr(message, "__definitions__", STANDARD)
    return found


def make(type_name: str, definitions: Definitions = STANDARD, /, **fields: Any) -> Any:
    """A message of `type_name` ("sensor_msgs/msg/LaserScan").

    Fields that are not given are zero or empty, as in ROS. Numbers and arrays are converted to the
    field's type. `definitions` holds the type, and those it refers to, if ROS does not bring them.
    RecordingError for an unknown type, an unknown field, or an array of wrong size.
    """
    store = typestore(definitions)
    if type_name not in store.fielddefs:
        raise RecordingError(
            f"'{type_name}' is not a message type of ROS 2 Humble"
            + (f", nor of the plugin ({', '.join(definitions)})" if definitions else "")
        )
    known = dict(store.fielddefs[type_name][1])
    unknown = [name for name in fields if name not in known]
    if unknown:
        raise RecordingError(f"{type_name} has no field '{unknown[0]}' (has: {', '.join(known)})")
    values = {
        name: _convert(f"{type_name}.{name}", kind, fields.get(name), definitions)
        for name, kind in known.items()
    }
    if type_name in definitions:
        return DefinedMessage(**values, __msgtype__=type_name, __definitions__=definitions)
    return store.types[type_name](**values)


def stamp(stamp_ns: int) -> Any:
    """builtin_interfaces/msg/Time of a stamp in ns."""
    return make("builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)


def header(stamp_ns: int, frame_id: str) -> Any:
    """std_msgs/msg/Header."""
    return make("std_msgs/msg/Header", stamp=stamp(stamp_ns), frame_id=frame_id)


def tf_static(transforms: Mapping[str, tuple[str, Array]], stamp_ns: int = 0) -> Any:
    """tf2_msgs/msg/TFMessage for topic /tf_static from frame -> (parent, `T_parent_frame`)."""
    entries = []
    for child, (parent, T_parent_child) in transforms.items():
        x, y, z, w = (float(v) for v in se3.quaternion_from_rotation(T_parent_child[:3, :3]))
        tx, ty, tz = (float(v) for v in T_parent_child[:3, 3])
        transform = make(
            "geometry_msgs/msg/Transform",
            translation=make("geometry_msgs/msg/Vector3", x=tx, y=ty, z=tz),
            rotation=make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w),
        )
        entries.append(
            make(
                "geometry_msgs/msg/TransformStamped",
                header=header(stamp_ns, parent),
                child_frame_id=child,
                transform=transform,
            )
        )
    return make(TF_TYPE, transforms=entries)


def _convert(where: str, kind: Any, value: Any, definitions: Definitions) -> Any:
    node, detail = kind
    if node == Nodetype.NAME:
        return make(detail, definitions) if value is None else value
    if node == Nodetype.BASE:
        return _scalar(detail[0], value)
    (item, item_detail), size = detail
    length = size if node == Nodetype.ARRAY else 0
    if item == Nodetype.NAME or item_detail[0] in _TEXT:
        filled = [_convert(where, (item, item_detail), None, definitions) for _ in range(length)]
        return filled if value is None else list(value)
    dtype = np.dtype(_DTYPES.get(item_detail[0], item_detail[0]))
    array = np.zeros(length, dtype) if value is None else np.ascontiguousarray(value, dtype).ravel()
    if node == Nodetype.ARRAY and len(array) != size:
        raise RecordingError(f"{where}: {len(array)} numbers, expected {size}")
    return array


def _scalar(name: str, value: Any) -> Any:
    if name in _TEXT:
        return "" if value is None else str(value)
    if name == "bool":
        return bool(value)
    if name.startswith("float"):
        return float(value or 0.0)
    return int(value or 0)
