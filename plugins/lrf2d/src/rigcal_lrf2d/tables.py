"""Scans in .csv and .npy files: two columns, angle and range, or x and y."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.errors import RecordingError
from rigcal.geometry.se3 import Array

_POLAR, _CARTESIAN = ("angle_rad", "range_m"), ("x_m", "y_m")
_CLOUD = ("x", "y", "z", "intensity", "ring")
_EXPECTED = "columns angle_rad, range_m or x_m, y_m"


def read_table(path: Path, origin: str) -> dict[str, NDArray[Any]]:
    """Columns of a scan: `angle_rad` and `range_m`, or `x` and `y` (m), and what else it names.

    A .csv may begin with a line of names, a .npy may be a structured array. Two columns without
    names are angle and range if the first one grows or falls throughout, by no more than a full
    turn, in whole steps (at least 9 of 10 of its steps within a fifth of a multiple of the
    median step), and the second is never negative; else they are x and y. Three to five columns
    are x, y, z, intensity, ring, as in a cloud. RecordingError on anything else.
    """
    try:
        names, columns = _read_csv(path) if path.suffix == ".csv" else _read_npy(path)
    except (OSError, ValueError, EOFError) as error:
        raise RecordingError(
            f"{origin}: cannot be read as a scan ({error}); expected {_EXPECTED}"
        ) from None
    if columns.ndim != 2 or columns.shape[0] == 0:
        raise RecordingError(
            f"{origin}: the table has shape {columns.shape}; expected {_EXPECTED}, a row per beam"
        )
    if names is None:
        names = _names_of(columns, origin)
    named = dict(zip(names, columns.T, strict=True))
    for pair in (_POLAR, _CARTESIAN, ("x", "y")):
        if set(pair) <= set(named):
            return {
                name.removesuffix("_m") if name in _CARTESIAN else name: values
                for name, values in named.items()
            }
    raise RecordingError(f"{origin}: columns {', '.join(names)}; expected {_EXPECTED}")


def _names_of(columns: Array, origin: str) -> tuple[str, ...]:
    """What columns without names are, by the rule of `read_table`."""
    width = columns.shape[1]
    if not 2 <= width <= len(_CLOUD):
        raise RecordingError(f"{origin}: {width} columns without names; expected {_EXPECTED}")
    if width > 2:
        return _CLOUD[:width]
    return _POLAR if looks_polar(columns) else _CARTESIAN


def looks_polar(columns: Array) -> bool:
    """Whether two columns (N, 2) without names are angle and range (see `read_table`)."""
    steps, ranges = np.diff(columns[:, 0]), columns[:, 1]
    if len(steps) == 0 or not np.all(np.isfinite(steps)):
        return False
    one_way = bool(np.all(steps > 0) or np.all(steps < 0))
    if not one_way or abs(float(steps.sum())) > 2 * np.pi + 0.1 or np.any(ranges < 0):
        return False
    multiples = steps / np.median(steps)
    whole = np.abs(multiples - np.round(multiples)) < 0.2
    return bool(np.mean(whole & (np.round(multiples) >= 1)) >= 0.9)


def _read_csv(path: Path) -> tuple[tuple[str, ...] | None, Array]:
    """Names in the first line, if it has any, and the numbers (N, M)."""
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    names = None
    if lines:
        first = tuple(word.strip() for word in lines[0].lstrip("#").split(","))
        if not all(_is_number(word) for word in first):
            names, lines = first, lines[1:]
    rows = [[float(word) for word in line.split(",")] for line in lines]
    width = len(names) if names else (len(rows[0]) if rows else 2)
    odd = next((i for i, row in enumerate(rows) if len(row) != width), None)
    if odd is not None:
        raise ValueError(f"row {odd + 1} has {len(rows[odd])} columns, others {width}")
    return names, np.array(rows, dtype=np.float64).reshape(-1, width)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _read_npy(path: Path) -> tuple[tuple[str, ...] | None, Array]:
    """Field names of a structured array, if it is one, and the numbers (N, M)."""
    table = np.load(path, allow_pickle=False)
    if table.dtype.names:
        names = tuple(table.dtype.names)
        return names, np.column_stack([table[name].astype(np.float64) for name in names])
    return None, np.asarray(table, dtype=np.float64)
