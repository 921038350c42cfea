"""What the built-in targets share: rectangles of the print, and the board around a pattern."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry.se3 import Array
from rigcal.targets.target import Patch, TargetConfig

_ROUNDING_M = 1e-9


def rectangle(left: float, bottom: float, width: float, height: float) -> Array:
    """(4, 2) corners: bottom-left, bottom-right, top-right, top-left (anticlockwise)."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    result: Array = np.array([left, bottom]) + corners * np.array([width, height])
    return result


def board_outline(config: TargetConfig, pattern_m: tuple[float, float]) -> Array:
    """(4, 2) outline of the board, centred on the origin, for a pattern of (width, height)."""
    width, height = config.width_m or pattern_m[0], config.height_m or pattern_m[1]
    return rectangle(-width / 2, -height / 2, width, height)


def check_board_holds(config: TargetConfig, pattern_m: tuple[float, float]) -> None:
    """ValueError if the pattern, moved by `offset_m`, does not lie within the board."""
    sides = (("width_m", config.width_m), ("height_m", config.height_m))
    for (key, size), pattern, offset in zip(sides, pattern_m, config.offset_m, strict=True):
        needed = pattern + 2 * abs(offset)
        if size is not None and size < pattern - _ROUNDING_M:
            raise ValueError(
                f"the pattern is larger than the board: it is {pattern:.4g} m and {key} is "
                f"{size:.4g} m; enlarge {key} or make the pattern smaller"
            )
        if needed > (size or pattern) + _ROUNDING_M:
            raise ValueError(
                f"the pattern reaches over the board's edge: {pattern:.4g} m moved by offset_m "
                f"{offset:.4g} m needs {key} >= {needed:.4g}, but it is {size or pattern:.4g}"
                f"{'' if size else ' (the pattern itself, as it is not given)'}"
            )


def cell_patches(
    cells: NDArray[np.bool_], left: float, top: float, cell_m: float, grey: float
) -> list[Patch]:
    """Patches for the true cells of (rows, columns), row 0 at the top; runs become one patch."""
    padded = np.pad(cells.astype(np.int8), ((0, 0), (1, 1)))
    steps = np.diff(padded, axis=1)
    row, start = np.nonzero(steps == 1)
    _, stop = np.nonzero(steps == -1)
    return [
        Patch(rectangle(left + a * cell_m, top - (r + 1) * cell_m, (b - a) * cell_m, cell_m), grey)
        for r, a, b in zip(row.tolist(), start.tolist(), stop.tolist(), strict=True)
    ]
