"""`charuco`: a chessboard with ArUco markers in its white squares, as OpenCV lays it out."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from rigcal.geometry.se3 import Array
from rigcal.targets.printed import board_outline, cell_patches, check_board_holds, rectangle
from rigcal.targets.target import Patch, Target, TargetConfig, TargetType

MARKERS_IN_DICTIONARY = {
    **{f"DICT_{n}X{n}_{size}": size for n in (4, 5, 6, 7) for size in (50, 100, 250, 1000)},
    "DICT_ARUCO_ORIGINAL": 1024,
    "DICT_APRILTAG_16h5": 30,
    "DICT_APRILTAG_25h9": 35,
    "DICT_APRILTAG_36h10": 2320,
    "DICT_APRILTAG_36h11": 587,
}


class CharucoConfig(TargetConfig, frozen=True):
    """`columns` and `rows` count squares, as OpenCV does."""

    type: Literal["charuco"] = "charuco"
    columns: int = Field(ge=2, description="squares side by side")
    rows: int = Field(ge=2, description="squares one above the other")
    square_size_m: float = Field(gt=0)
    marker_size_m: float = Field(gt=0, description="outer edge of a marker's black border")
    dictionary: str = Field(
        default="DICT_4X4_1000",
        description="OpenCV's name of the markers' dictionary",
        json_schema_extra={"enum": list(MARKERS_IN_DICTIONARY)},
    )
    legacy_pattern: bool = Field(
        default=False, description="layout of OpenCV before 4.6 (differs for even `rows`)"
    )
    inverted: bool = Field(default=False, description="printed with black and white swapped")

    @model_validator(mode="after")
    def _is_printable(self) -> CharucoConfig:
        if self.marker_size_m >= self.square_size_m:
            raise ValueError(
                f"marker_size_m {self.marker_size_m:.4g} does not fit into square_size_m "
                f"{self.square_size_m:.4g}; markers must be smaller than squares"
            )
        size = MARKERS_IN_DICTIONARY.get(self.dictionary)
        if size is None:
            known = ", ".join(MARKERS_IN_DICTIONARY)
            raise ValueError(f"unknown dictionary '{self.dictionary}'; known are {known}")
        needed = self.columns * self.rows // 2
        if needed > size:
            raise ValueError(
                f"{self.columns} x {self.rows} squares hold {needed} markers, but "
                f"{self.dictionary} has {size}; use fewer squares or a larger dictionary"
            )
        check_board_holds(self, self.pattern_m)
        return self

    @property
    def pattern_m(self) -> tuple[float, float]:
        """Width and height of the printed squares."""
        return (self.columns * self.square_size_m, self.rows * self.square_size_m)


def opencv_board(config: CharucoConfig) -> Any:
    """The `cv2.aruco.CharucoBoard` of this target (its y points down, its origin is top left)."""
    import cv2

    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, config.dictionary))
    size = (config.columns, config.rows)
    board = cv2.aruco.CharucoBoard(size, config.square_size_m, config.marker_size_m, dictionary)
    board.setLegacyPattern(config.legacy_pattern)
    return board


def _black_squares(config: CharucoConfig) -> NDArray[np.bool_]:
    top_left_white = config.legacy_pattern and config.rows % 2 == 0
    odd: NDArray[np.bool_] = np.indices((config.rows, config.columns)).sum(axis=0) % 2 == 1
    return odd if top_left_white else ~odd


def _marker_patches(config: CharucoConfig, board: Any, left: float, top: float) -> list[Patch]:
    import cv2

    dictionary = board.getDictionary()
    cells = dictionary.markerSize + 2
    size = config.marker_size_m
    patches: list[Patch] = []
    for marker_id, corners in zip(board.getIds(), board.getObjPoints(), strict=True):
        image = cv2.aruco.generateImageMarker(dictionary, int(marker_id), cells)
        x, y = left + float(corners[0][0]), top - float(corners[0][1])
        patches.append(Patch(rectangle(x, y - size, size, size), 0.0))
        patches += cell_patches(np.asarray(image) > 127, x, y, size / cells, 1.0)
    return patches


def build_charuco(name: str, config: TargetConfig) -> Target:
    """The target; point i is OpenCV's ChArUco corner i (row by row from the top left).

    Groups: `grid` (rows - 1, columns - 1) indices into `points`, row 0 at the top.
    """
    assert isinstance(config, CharucoConfig)
    board = opencv_board(config)
    width, height = config.pattern_m
    left, top = config.offset_m[0] - width / 2, config.offset_m[1] + height / 2
    square = config.square_size_m
    x, y = np.meshgrid(np.arange(1, config.columns), np.arange(1, config.rows))
    points: Array = np.stack([left + x * square, top - y * square, 0.0 * x], axis=-1)
    patches = [Patch(rectangle(left, top - height, width, height), 1.0)]
    patches += cell_patches(_black_squares(config), left, top, square, 0.0)
    patches += _marker_patches(config, board, left, top)
    if config.inverted:
        patches = [Patch(p.polygon, 1.0 - p.grey) for p in patches]
    return Target(
        name=name,
        config=config,
        outline=board_outline(config, config.pattern_m),
        points=points.reshape(-1, 3),
        groups={"grid": np.arange(x.size).reshape(x.shape)},
        patches=tuple(patches),
    )


CHARUCO = TargetType("charuco", CharucoConfig, build_charuco)
