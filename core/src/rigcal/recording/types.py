"""Deserialisers from the message definitions that a bag carries."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any

from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from rigcal.errors import RecordingError
from rigcal.recording.message import STANDARD, Definitions
from rigcal.recording.ros import ros1_typestore, typestore

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

Deserialize = Callable[[bytes], Any]


def deserializer(
    connections: Sequence[Connection],
    ros_version: int,
    definitions: Definitions = STANDARD,
    *,
    compressed: bool,
) -> Deserialize:
    """Bytes of a message -> the message, for connections of one message type.

    The definition in the bag counts; bags of older ROS 2 versions carry none, then the type is
    that of ROS 2 Humble or of `definitions`. `compressed`: each message is compressed (zstd).
    Field names are those of the bag's ROS version (a ROS 1 CameraInfo has K, not k).
    RecordingError for an unknown type.
    """
    name = connections[0].msgtype
    store = _typestore(connections, ros_version, definitions)
    if name not in store.fielddefs:
        raise RecordingError(
            f"message type '{name}' is not defined in the recording and is not a standard one; "
            "convert the recording to MCAP (`ros2 bag convert`) where the type is installed"
        )
    decode = store.deserialize_ros1 if ros_version == 1 else store.deserialize_cdr
    if not compressed:
        return lambda data: decode(data, name)
    return lambda data: decode(zstd.decompress(data), name)


def _typestore(
    connections: Sequence[Connection], ros_version: int, definitions: Definitions
) -> Typestore:
    definition = next(
        (c.msgdef for c in connections if c.msgdef.format != MessageDefinitionFormat.NONE), None
    )
    if definition is None or not definition.data.strip():
        return ros1_typestore(definitions) if ros_version == 1 else typestore(definitions)
    store = get_typestore(Stores.EMPTY)
    if definition.format == MessageDefinitionFormat.MSG:
        store.register(get_types_from_msg(definition.data, connections[0].msgtype))
        return store
    types = {}
    # One IDL file per type, each under a rule of 80 signs and a line `IDL: package/msg/Name`.
    for part in definition.data.split("=" * 80 + "\n"):
        text = part.partition("\n")[2] if part.startswith("IDL: ") else part
        if text.strip():
            types.update(get_types_from_idl(text))
    store.register(types)
    return store
