"""Point clouds of messages and files as named columns."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.errors import RecordingError
from rigcal.recording import cloud_files, ros
from rigcal.recording.message import Message

POINT_CLOUD2 = "sensor_msgs/msg/PointCloud2"
CLOUD_TYPES: tuple[str, ...] = (POINT_CLOUD2, *cloud_files.READERS)
"""Message types and file suffixes that `read_cloud` accepts."""

_DATATYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""sensor_msgs/PointField constants."""
_DATATYPE_OF = {name: number for number, name in _DATATYPES.items()}

Fields = dict[str, NDArray[Any]]


def read_cloud(message: Message) -> Fields:
    """Field name -> (N,) values in their own type; coordinates x, y, z in metres.

    Non-finite points are kept, organised clouds are flattened row by row. A field of several values
    becomes `name_0`, `name_1`, ... RecordingError, with the message's origin, for data that are
    truncated or garbled. Which fields there must be is for the caller to check.
    """
    if message.type == POINT_CLOUD2:
        return _from_point_cloud2(message.value, message.origin)
    reader = cloud_files.READERS.get(message.type)
    if reader is None:
        raise RecordingError(
            f"{message.origin}: a {message.type} is not a point cloud; expected one of "
            f"{', '.join(CLOUD_TYPES)}"
        )
    return cloud_files.read(reader, Path(message.value), message.origin)


def cloud_message(fields: Mapping[str, NDArray[Any]], stamp_ns: int, frame_id: str) -> Any:
    """PointCloud2 of (N,) columns, packed in their order, little-endian, in their own types.

    RecordingError for a type that PointField does not know (64-bit integers, booleans) and for
    columns of unequal length.
    """
    columns = {name: np.asarray(values) for name, values in fields.items()}
    for name, values in columns.items():
        if values.dtype.str[1:] not in _DATATYPE_OF:
            raise RecordingError(
                f"point field '{name}' is {values.dtype}; PointCloud2 has {_known_types()}: "
                "convert it"
            )
    sizes = {name: values.shape for name, values in columns.items()}
    if len(set(sizes.values())) != 1 or len(next(iter(sizes.values()))) != 1:
        raise RecordingError(f"the fields of a cloud must be (N,) of one N, found {sizes}")
    layout = np.dtype([(name, values.dtype.newbyteorder("<")) for name, values in columns.items()])
    points = np.empty(next(iter(sizes.values())), layout)
    for name, values in columns.items():
        points[name] = values
    assert layout.fields is not None
    return ros.make(
        POINT_CLOUD2,
        header=ros.header(stamp_ns, frame_id),
        height=1,
        width=len(points),
        fields=[
            ros.make(
                "sensor_msgs/msg/PointField",
                name=name,
                offset=layout.fields[name][1],
                datatype=_DATATYPE_OF[values.dtype.str[1:]],
                count=1,
            )
            for name, values in columns.items()
        ],
        point_step=layout.itemsize,
        row_step=layout.itemsize * len(points),
        data=points.view(np.uint8),
        is_dense=all(
            bool(np.isfinite(values).all())
            for values in columns.values()
            if values.dtype.kind == "f"
        ),
    )


def _from_point_cloud2(cloud: Any, origin: str) -> Fields:
    """Any layout: gaps, padded rows, either byte order."""
    width, height, step = int(cloud.width), int(cloud.height), int(cloud.point_step)
    if not cloud.fields:
        raise RecordingError(f"{origin}: the cloud's points have no fields; expected x, y, z")
    if width * height == 0:
        return {str(f.name): np.zeros(0, _field_dtype(f, ">", origin).base) for f in cloud.fields}
    layout = _layout(cloud, origin)
    row = int(cloud.row_step) or width * step  # several drivers leave it 0
    data = np.ascontiguousarray(cloud.data).view(np.uint8)
    if row < width * step or len(data) < (height - 1) * row + width * step:
        raise RecordingError(
            f"{origin}: the cloud has {len(data)} bytes of data in rows of {row}; {height} x "
            f"{width} points of {step} bytes need {height * width * step}: the message is damaged"
        )
    rows = np.lib.stride_tricks.as_strided(data, (height, width * step), (row, 1), writeable=False)
    points = np.ascontiguousarray(rows).reshape(-1).view(layout)
    fields: Fields = {}
    for field in cloud.fields:
        values = points[field.name]
        native = values.astype(values.dtype.newbyteorder("="))
        if native.ndim == 1:
            fields[field.name] = native
        else:
            fields |= {f"{field.name}_{i}": native[:, i].copy() for i in range(native.shape[1])}
    return fields


def _layout(cloud: Any, origin: str) -> np.dtype[np.void]:
    order = ">" if cloud.is_bigendian else "<"
    step = int(cloud.point_step)
    dtypes = [_field_dtype(f, order, origin) for f in cloud.fields]
    for field, dtype in zip(cloud.fields, dtypes, strict=True):
        end = int(field.offset) + dtype.itemsize
        if end > step:
            raise RecordingError(
                f"{origin}: point field '{field.name}' ends at byte {end} of points of {step} "
                "bytes: the message is damaged"
            )
    try:
        return np.dtype(
            {
                "names": [str(f.name) for f in cloud.fields],
                "formats": dtypes,
                "offsets": [int(f.offset) for f in cloud.fields],
                "itemsize": step,
            }
        )
    except ValueError as error:
        raise RecordingError(f"{origin}: the cloud's fields make no layout: {error}") from error


def _field_dtype(field: Any, order: str, origin: str) -> np.dtype[Any]:
    name = _DATATYPES.get(int(field.datatype))
    if name is None:
        raise RecordingError(
            f"{origin}: point field '{field.name}' has datatype {field.datatype}; expected 1 to 8"
        )
    count = int(field.count)
    base = np.dtype(f"{order}{name}")
    # Some drivers leave the count 0.
    if count <= 1:
        return base
    try:
        return np.dtype((base, (count,)))
    except ValueError as error:
        raise RecordingError(
            f"{origin}: point field '{field.name}' has {count} values in each point: {error}"
        ) from error


def _known_types() -> str:
    return ", ".join(str(np.dtype(name)) for name in _DATATYPE_OF)
