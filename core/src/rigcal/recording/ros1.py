"""Messages of ROS 2 in the classes of ROS 1."""

from __future__ import annotations

from typing import Any

from rosbags.interfaces import Nodetype

from rigcal.errors import RecordingError
from rigcal.recording import ros
from rigcal.recording.message import STANDARD, Definitions

_HEADER = "std_msgs/msg/Header"


def to_ros1(message: Any, type_name: str, seq: int = 0, definitions: Definitions = STANDARD) -> Any:
    """The same message as ROS 1 Noetic defines it; large arrays are shared, not copied.

    Fields are matched by name whatever their case (CameraInfo's k is K in ROS 1). `seq` goes into
    the message's own header, which ROS 2 no longer numbers. `definitions` as in
    `ros.make`. KeyError for a type that ROS 1 does not have; RecordingError for one that has other
    fields there.
    """
    store = ros.ros1_typestore(definitions)
    given = {name.lower(): value for name, value in vars(message).items() if name[:2] != "__"}
    values = {}
    for name, kind in store.fielddefs[type_name][1]:
        if type_name == _HEADER and name == "seq":
            values[name] = seq
        elif name.lower() in given:
            values[name] = _value(given[name.lower()], kind, seq, definitions)
        else:
            raise RecordingError(
                f"the message has no '{name}', which {type_name} has in ROS 1 (it has: "
                f"{', '.join(given)})"
            )
    return store.types[type_name](**values)


def _value(value: Any, kind: Any, seq: int, definitions: Definitions) -> Any:
    node, detail = kind
    if node == Nodetype.NAME:
        return to_ros1(value, detail, seq if detail == _HEADER else 0, definitions)
    if node == Nodetype.BASE:
        return value
    (item, name), _ = detail
    if item != Nodetype.NAME:
        return value
    return [to_ros1(v, name, definitions=definitions) for v in value]
