"""Corners of checkerboards and ChArUco boards."""

from __future__ import annotations

from functools import lru_cache
from threading import get_ident
from typing import Any

import numpy as np

from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import inside_convex
from rigcal.targets.target import Target
from rigcal_camera.corners import Corners, no_corners, refine_saddles, sample
from rigcal_camera.frames import Image
from rigcal_camera.lens import Lens


def find_checkerboard_corners(image: Image, target: Target, lens: Lens) -> Corners:
    """All inner corners of a checkerboard, or none.

    Which way round the board is follows from the colour of its squares, as far as that tells.
    """
    rows, columns = target.groups["grid"].shape
    uv = _chessboard(image, columns, rows)
    if uv is None:
        return no_corners(
            f"no checkerboard of {columns} x {rows} inner corners found (all of them must be in "
            "the image, with a white margin around the squares)"
        )
    grid = _right_handed(uv)
    turns = (0, 1, 2, 3) if rows == columns else (0, 2)
    turned = [np.rot90(grid, turn) for turn in turns]
    expected = _square_greys(target)
    agreement = [float(np.sum(expected * sample(image, _centres(t)))) for t in turned]
    best = turned[int(np.argmax(agreement))]
    return Corners(target.groups["grid"].ravel(), best.reshape(-1, 2))


def _chessboard(image: Image, columns: int, rows: int) -> Array | None:
    """Corners (rows, columns, 2) in the order in which OpenCV saw them.

    `cornerSubPix` with a window of 0.4 squares is three times as accurate as the positions of
    `findChessboardCornersSB`, which finds some boards that the other search does not.
    """
    import cv2

    size = (columns, rows)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    found, uv = cv2.findChessboardCorners(image, size, flags=flags)
    if not found:
        found, uv = cv2.findChessboardCornersSB(image, size)
    if not found:
        return None
    grid: Array = np.asarray(uv, dtype=np.float64).reshape(rows, columns, 2)
    refined = refine_saddles(image, grid.reshape(-1, 2), 0.4 * _spacing(grid).ravel())
    return refined.reshape(grid.shape)


def _spacing(grid: Array) -> Array:
    """Distance (rows, columns) from each corner to the nearest of its neighbours in the grid."""
    across = np.linalg.norm(np.diff(grid, axis=1), axis=2)
    down = np.linalg.norm(np.diff(grid, axis=0), axis=2)
    across = np.pad(across, ((0, 0), (1, 1)), constant_values=np.inf)
    down = np.pad(down, ((1, 1), (0, 0)), constant_values=np.inf)
    result: Array = np.minimum(
        np.minimum(across[:, 1:], across[:, :-1]), np.minimum(down[1:], down[:-1])
    )
    return result


def _right_handed(grid: Array) -> Array:
    """Pixels (rows, columns, 2) with rows running down where columns run right, as printed."""
    right, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    mirrored = bool(right[0] * down[1] - right[1] * down[0] < 0)
    result: Array = grid[:, ::-1] if mirrored else grid
    return result


def _centres(grid: Array) -> Array:
    """Centres (rows - 1, columns - 1, k) of the squares between the corners."""
    result: Array = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4
    return result


def _square_greys(target: Target) -> Array:
    """Printed grey at the centres of the inner squares, +0.5 white and -0.5 black."""
    centres = _centres(target.points[target.groups["grid"]])[..., :2]
    grey = np.ones(centres.shape[:-1])
    for patch in target.patches:
        grey[inside_convex(centres, patch.polygon)] = patch.grey
    result: Array = grey - grey.mean()
    return result


@lru_cache(maxsize=8)
def _charuco_detector(config: Any, thread: int) -> Any:
    import cv2

    from rigcal.targets.charuco import opencv_board

    return cv2.aruco.CharucoDetector(opencv_board(config))


def find_charuco_corners(image: Image, target: Target, lens: Lens) -> Corners:
    """The chessboard corners of a ChArUco board that lie between markers found."""
    config: Any = target.config
    detector = _charuco_detector(config, get_ident())
    uv, ids, _, markers = detector.detectBoard(255 - image if config.inverted else image)
    if ids is None or len(ids) == 0:
        seen = 0 if markers is None else len(markers)
        return no_corners(
            f"found {seen} markers of {config.dictionary} and no chessboard corner between them"
        )
    return Corners(
        np.asarray(ids, dtype=np.int64).ravel(), np.asarray(uv, dtype=np.float64).reshape(-1, 2)
    )
