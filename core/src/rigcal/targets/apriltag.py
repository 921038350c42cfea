"""AprilTags as patches: what grids and posters of them share."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rigcal.targets.printed import cell_patches, rectangle
from rigcal.targets.target import Patch

Family = Literal["tag16h5", "tag25h9", "tag36h10", "tag36h11"]
TAGS_IN_FAMILY = {"tag16h5": 30, "tag25h9": 35, "tag36h10": 2320, "tag36h11": 587}


def tag_patches(
    family: str, tag_id: int, border_cells: int, left: float, bottom: float, size_m: float
) -> list[Patch]:
    """The upright tag with its bottom-left corner at (left, bottom): black, then white cells."""
    cells = _tag_cells(family, tag_id, border_cells)
    white = cell_patches(cells, left, bottom + size_m, size_m / len(cells), 1.0)
    return [Patch(rectangle(left, bottom, size_m, size_m), 0.0), *white]


def _tag_cells(family: str, tag_id: int, border_cells: int) -> NDArray[np.bool_]:
    """(n, n) cells of the upright tag with its border, row 0 at the top; true is white.

    Upright as the AprilTag library and Kalibr print it, which is OpenCV's marker upside down.
    """
    import cv2

    name = f"DICT_APRILTAG_{family.removeprefix('tag').upper()}"
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    cells = dictionary.markerSize + 2 * border_cells
    image = cv2.aruco.generateImageMarker(dictionary, tag_id, cells, borderBits=border_cells)
    white: NDArray[np.bool_] = np.asarray(image) > 127
    return white[::-1, ::-1]
