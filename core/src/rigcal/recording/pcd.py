"""PCD files of the Point Cloud Library, version 0.7 and before: ascii, binary, compressed."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

_KEYS = (
    "VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA",
)  # fmt: skip
_KINDS = {"F": "f", "I": "i", "U": "u"}


def read_pcd(path: Path) -> dict[str, NDArray[Any]]:
    """Field name -> (N,); padding (`_`) is dropped, a field of several values gets numbers.

    ValueError for anything that is not a whole PCD file.
    """
    with path.open("rb") as file:
        header = _header(file)
        layout = _layout(header)
        count = _number(header, "POINTS", _number(header, "WIDTH") * _number(header, "HEIGHT", 1))
        encoding = " ".join(header["DATA"])
        if count == 0:
            points = np.zeros(0, layout)
        elif encoding == "ascii":
            points = _ascii(file, layout)
        elif encoding == "binary":
            data = file.read(count * layout.itemsize)
            points = np.frombuffer(data[: len(data) // layout.itemsize * layout.itemsize], layout)
        elif encoding == "binary_compressed":
            points = _compressed(file, layout, count)
        else:
            raise ValueError(f"DATA {encoding}; expected ascii, binary or binary_compressed")
    if len(points) != count:
        raise ValueError(f"the header says {count} points, the file holds {len(points)}")
    return _fields(points)


def _header(file: BinaryIO) -> dict[str, list[str]]:
    header: dict[str, list[str]] = {}
    while "DATA" not in header:
        line = file.readline(1 << 16)
        if not line:
            raise ValueError("the header has no line DATA")
        words = line.decode("ascii", "replace").split("#")[0].split()
        if not words:
            continue
        if words[0] not in _KEYS:
            raise ValueError(f"the header has a line '{words[0][:20]}', which PCD does not know")
        header[words[0]] = words[1:]
    for key in ("FIELDS", "SIZE", "TYPE", "WIDTH"):
        if not header.get(key):
            raise ValueError(f"the header has no line {key}")
    return header


def _number(header: dict[str, list[str]], key: str, default: int | None = None) -> int:
    words = header.get(key)
    if words is None and default is not None:
        return default
    number = int((words or [""])[0])
    if number < 0:
        raise ValueError(f"{key} {number} is negative")
    return number


def _layout(header: dict[str, list[str]]) -> np.dtype[np.void]:
    names = header["FIELDS"]
    counts = [int(c) for c in header.get("COUNT", ["1"] * len(names))]
    if not len(names) == len(header["SIZE"]) == len(header["TYPE"]) == len(counts):
        raise ValueError("FIELDS, SIZE, TYPE and COUNT have different lengths")
    fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
    for i, (name, size, kind, count) in enumerate(
        zip(names, header["SIZE"], header["TYPE"], counts, strict=True)
    ):
        if kind not in _KINDS:
            raise ValueError(f"field {name} has TYPE {kind}; expected F, I or U")
        dtype = f"<{_KINDS[kind]}{int(size)}"
        own = f"_{i}" if name == "_" else name
        fields.append((own, dtype) if count == 1 else (own, dtype, (count,)))
    return np.dtype(fields)


def _ascii(file: BinaryIO, layout: np.dtype[np.void]) -> NDArray[np.void]:
    lines = [line for line in file.read().decode("ascii").splitlines() if line.strip()]
    # Without lines numpy would warn; the caller reports the missing points.
    return np.loadtxt(lines, layout, ndmin=1) if lines else np.zeros(0, layout)


def _compressed(file: BinaryIO, layout: np.dtype[np.void], count: int) -> NDArray[np.void]:
    """LZF-compressed, field after field instead of point after point."""
    import lzf

    compressed_size, size = struct.unpack("<II", file.read(8))
    compressed = file.read(compressed_size)
    data = lzf.decompress(compressed, size) if len(compressed) == compressed_size else None
    if data is None or len(data) != size or size != count * layout.itemsize:
        raise ValueError(
            f"{len(compressed)} of {compressed_size} compressed bytes give "
            f"{0 if data is None else len(data)} bytes; {count} points need "
            f"{count * layout.itemsize}"
        )
    points = np.zeros(count, layout)
    offset = 0
    for name in layout.names or ():
        column = np.frombuffer(data, layout[name].base, points[name].size, offset)
        points[name] = column.reshape(points[name].shape)
        offset += column.nbytes
    return points


def _fields(points: NDArray[np.void]) -> dict[str, NDArray[Any]]:
    fields: dict[str, NDArray[Any]] = {}
    for name in points.dtype.names or ():
        if name[0] == "_" and name[1:].isdigit():
            continue
        values = points[name]
        if values.ndim == 1:
            fields[name] = values.astype(values.dtype.newbyteorder("="))
        else:
            fields |= {f"{name}_{i}": values[:, i].copy() for i in range(values.shape[1])}
    return fields
