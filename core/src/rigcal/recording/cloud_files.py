"""Point cloud files: .pcd, .ply, .npy, .csv and Velodyne .bin."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.errors import RecordingError
from rigcal.recording.pcd import read_pcd

Fields = dict[str, NDArray[Any]]
Reader = Callable[[Path], Fields]


def read(reader: Reader, path: Path, origin: str) -> Fields:
    """The file's fields; RecordingError with `origin` for whatever goes wrong."""
    try:
        return reader(path)
    except OSError as error:
        raise RecordingError(f"{origin}: cannot be read: {error.strerror or error}") from error
    except Exception as error:  # of memory too, which damaged lengths ask for
        raise RecordingError(f"{origin}: not a whole {path.suffix} point cloud: {error}") from error


def _read_ply(path: Path) -> Fields:
    """The `vertex` element, without its list properties."""
    from plyfile import PlyData

    elements = {element.name: element for element in PlyData.read(str(path)).elements}
    if "vertex" not in elements:
        raise ValueError(f"it has no element 'vertex' (has: {', '.join(elements)})")
    data = elements["vertex"].data
    return {
        name: np.array(data[name], data.dtype[name].newbyteorder("="))
        for name in data.dtype.names
        if data.dtype[name].kind != "O"
    }


def _read_npy(path: Path) -> Fields:
    """A structured array by its names; columns of (N, >= 3) are x, y, z, column_4, ..."""
    data = np.load(path, allow_pickle=False)
    if not isinstance(data, np.ndarray):
        raise ValueError("it is an archive of several arrays; expected one array")
    if data.dtype.names:
        flat = data.reshape(-1)
        return {name: np.ascontiguousarray(flat[name]) for name in data.dtype.names}
    if data.ndim != 2 or data.shape[1] < 3 or data.dtype.kind not in "fiu":
        raise ValueError(
            f"it holds {data.dtype} {data.shape}; expected numbers (N, 3 or more) or a structured "
            "array with x, y, z"
        )
    return dict(zip(_names(data.shape[1]), np.ascontiguousarray(data.T), strict=True))


def _read_csv(path: Path) -> Fields:
    """Columns by the first line's names (x, y, z or x_m, y_m, z_m), else x, y, z, column_4, ...

    Separated by commas, semicolons, tabs or blanks; lines that begin with # are comments.
    """
    with path.open(encoding="utf-8-sig") as file:
        first = next((line for line in file if line.strip()), "")
    if not first:
        raise ValueError("it is empty")
    delimiter = next((d for d in ",;\t" if d in first), None)
    words = [w.strip().strip("\"'") for w in first.strip().lstrip("#").split(delimiter)]
    named = not all(_is_number(w) for w in words)
    comment = first.lstrip().startswith("#")
    with path.open(encoding="utf-8-sig") as file:
        lines = (line for line in file if line.strip() and not line.lstrip().startswith("#"))
        if named and not comment:
            next(lines)
        rows = list(lines)
    data = np.loadtxt(rows, delimiter=delimiter, ndmin=2) if rows else np.zeros((0, len(words)))
    if data.shape[1] < 3:
        raise ValueError(f"it has {data.shape[1]} columns; expected x, y, z and perhaps more")
    if named and len(words) == data.shape[1]:
        return _columns([_plain(w) for w in words], data)
    if named and not comment:
        raise ValueError(f"{len(words)} names stand above {data.shape[1]} columns")
    return _columns(_names(data.shape[1]), data)


def _read_bin(path: Path) -> Fields:
    """KITTI's Velodyne files: float32 x, y, z, intensity."""
    size = path.stat().st_size
    if size % 16:
        raise ValueError(f"{size} bytes are not a multiple of 16 (4 float32 per point)")
    points = np.fromfile(path, "<f4").reshape(-1, 4)
    return _columns(["x", "y", "z", "intensity"], points)


def _columns(names: list[str], data: NDArray[Any]) -> Fields:
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise ValueError(f"two columns are named '{twice[0]}'")
    return dict(zip(names, np.ascontiguousarray(data.T), strict=True))


def _names(count: int) -> list[str]:
    return ["x", "y", "z", *(f"column_{i}" for i in range(4, count + 1))]


def _plain(word: str) -> str:
    """`X_m` and `x` are the same coordinate."""
    name = word.lower().removesuffix("_m")
    return name if name in ("x", "y", "z") else word


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


READERS: dict[str, Reader] = {
    ".pcd": read_pcd,
    ".ply": _read_ply,
    ".npy": _read_npy,
    ".csv": _read_csv,
    ".bin": _read_bin,
}
