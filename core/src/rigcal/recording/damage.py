"""What can still be read of a damaged bag, and what to do about it."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

_MCAP_MAGIC = b"\x89MCAP0\r\n"
_BAG_MAGIC = b"#ROSBAG V2.0\n"
_MCAP_MESSAGE, _MCAP_INDEX, _MCAP_FOOTER = 0x05, 0x07, 0x02
_MCAP_HEADER = 0x01
_BAG_INDEX, _BAG_CHUNK = b"op=\x04", b"op=\x05"


def advice(path: Path) -> str:
    """Text to follow an error message about the bag at `path`, beginning with "; "."""
    try:
        # What has no suffix of a bag is a folder, also when it has gone.
        advise = _folder if path.is_dir() else _ADVICE.get(path.suffix, _folder)
        return advise(path)
    except (OSError, struct.error):
        # It went away, say with the disk that it was on; or a record is shorter than its kind is.
        return ""


def _mcap(path: Path) -> str:
    size = path.stat().st_size
    if size == 0:
        return "; the file is empty: record it again"
    with path.open("rb") as file:
        if file.read(len(_MCAP_MAGIC)) != _MCAP_MAGIC:
            return "; it does not begin like an MCAP file: check what it is"
        messages = whole = 0
        for op, head, end in _mcap_records(file, size):
            whole = end
            if op == _MCAP_HEADER and (profile := _profile(head)) != "ros2":
                return (
                    f"; its profile is '{profile}': give the .bag that it was made from, or "
                    "convert it to a ROS 2 bag"
                )
            if op == _MCAP_FOOTER:
                return (
                    "; it has its end, but may be damaged inside: keep what is whole with "
                    f"`mcap recover {path.name} -o mended.mcap`"
                )
            messages += op == _MCAP_MESSAGE
            if op == _MCAP_INDEX:
                messages += struct.unpack("<I", head[2:6])[0] // 16
    return (
        f"; it breaks off: {_share(whole, size)} with {messages} messages can be read, keep them "
        f"with `mcap recover {path.name} -o mended.mcap`"
    )


def _mcap_records(file: BinaryIO, size: int) -> Iterator[tuple[int, bytes, int]]:
    """(op, first bytes, end) of the whole records at the file's top level."""
    position = len(_MCAP_MAGIC)
    while position + 9 <= size:
        file.seek(position)
        op, length = struct.unpack("<BQ", file.read(9))
        if position + 9 + length > size:
            return
        head = file.read(min(length, 16))
        position += 9 + length
        yield op, head, position


def _profile(head: bytes) -> str:
    return head[4 : 4 + struct.unpack("<I", head[:4])[0]].decode("ascii", "replace")


def _ros1(path: Path) -> str:
    size = path.stat().st_size
    if size == 0:
        return "; the file is empty: record it again"
    with path.open("rb") as file:
        if file.read(len(_BAG_MAGIC)) != _BAG_MAGIC:
            return "; it does not begin like a ROS 1 bag of version 2.0: check what it is"
        messages = chunks = 0
        whole = len(_BAG_MAGIC)
        for header, data, end in _bag_records(file, size):
            whole = end
            chunks += _BAG_CHUNK in header
            if _BAG_INDEX in header:
                messages += data // 12
    return (
        f"; {_share(whole, size)} with {chunks} chunks and {messages} indexed messages can be "
        f"read: rebuild the index with `rosbag reindex {path.name}`"
    )


def _bag_records(file: BinaryIO, size: int) -> Iterator[tuple[bytes, int, int]]:
    """(header, length of the data, end) of the whole records."""
    position = len(_BAG_MAGIC)
    while position + 8 <= size:
        file.seek(position)
        (header_length,) = struct.unpack("<I", file.read(4))
        if position + 8 + header_length > size:
            return
        header = file.read(header_length)
        (data_length,) = struct.unpack("<I", file.read(4))
        position += 8 + header_length + data_length
        if position > size:
            return
        yield header, data_length, position


def _sqlite(path: Path) -> str:
    return (
        f"; {path.stat().st_size} bytes: what is whole can be kept with "
        f"`sqlite3 {path.name} .recover | sqlite3 mended.db3`"
    )


def _folder(path: Path) -> str:
    """Advice of the first damaged file in it, else on the metadata."""
    for file in sorted(path.iterdir()):
        if file.suffix == ".mcap" and (text := _mcap(file)):
            return f" ({file.name}{text})"
    return (
        "; a bag folder whose metadata.yaml is missing or wrong is mended by "
        f"`ros2 bag reindex {path.name}`"
    )


def _share(whole: int, size: int) -> str:
    return f"{whole / 1e6:.3g} of {size / 1e6:.3g} MB"


_ADVICE: dict[str, Callable[[Path], str]] = {
    ".mcap": _mcap,
    ".bag": _ros1,
    ".db3": _sqlite,
}
