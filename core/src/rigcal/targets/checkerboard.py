"""`checkerboard`: a plain chessboard pattern."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from rigcal.targets.printed import board_outline, cell_patches, check_board_holds
from rigcal.targets.target import Target, TargetConfig, TargetType


class CheckerboardConfig(TargetConfig, frozen=True):
    """The top-left square is black; there is one more square than inner corners each way."""

    type: Literal["checkerboard"] = "checkerboard"
    columns: int = Field(ge=2, description="inner corners side by side")
    rows: int = Field(ge=2, description="inner corners one above the other")
    square_size_m: float = Field(gt=0)

    @model_validator(mode="after")
    def _is_printable(self) -> CheckerboardConfig:
        check_board_holds(self, self.pattern_m)
        return self

    @property
    def pattern_m(self) -> tuple[float, float]:
        """Width and height of the printed squares."""
        return ((self.columns + 1) * self.square_size_m, (self.rows + 1) * self.square_size_m)


def _symmetries(grid: NDArray[np.int64]) -> tuple[NDArray[np.int64], ...]:
    """Rotations other than the identity that map black squares on black ones.

    Half a turn takes square (r, c) of R x C to (R-1-r, C-1-c): its colour r + c keeps its parity
    if R + C is even, that is when both counts of inner corners are odd or both even. A quarter
    turn of a square board, (r, c) to (c, R-1-r), keeps it if R is odd.
    """
    rows, columns = grid.shape
    if rows == columns and rows % 2 == 0:
        turns: tuple[int, ...] = (1, 2, 3)
    else:
        turns = (2,) if (rows + columns) % 2 == 0 else ()
    return tuple(np.rot90(grid, k).ravel() for k in turns)


def build_checkerboard(name: str, config: TargetConfig) -> Target:
    """The target; `points` are the inner corners, row by row from the top left.

    Groups: `grid` (rows, columns) indices into `points`, row 0 at the top, left to right. The
    square to the upper left of `grid[0, 0]` is black.
    """
    assert isinstance(config, CheckerboardConfig)
    square = config.square_size_m
    left = config.offset_m[0] - config.pattern_m[0] / 2
    top = config.offset_m[1] + config.pattern_m[1] / 2
    x = left + square * np.arange(1, config.columns + 1)
    y = top - square * np.arange(1, config.rows + 1)
    xy = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    grid = np.arange(len(xy)).reshape(config.rows, config.columns)
    black = np.indices((config.rows + 1, config.columns + 1)).sum(axis=0) % 2 == 0
    return Target(
        name=name,
        config=config,
        outline=board_outline(config, config.pattern_m),
        points=np.column_stack([xy, np.zeros(len(xy))]),
        groups={"grid": grid},
        symmetries=_symmetries(grid),
        patches=tuple(cell_patches(black, left, top, square, 0.0)),
    )


CHECKERBOARD = TargetType("checkerboard", CheckerboardConfig, build_checkerboard)
