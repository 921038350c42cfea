"""`apriltag_grid`: AprilTags in rows and columns, as Kalibr and others print them."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from rigcal.geometry.se3 import Array
from rigcal.targets.apriltag import TAGS_IN_FAMILY, Family, tag_patches
from rigcal.targets.printed import board_outline, check_board_holds, rectangle
from rigcal.targets.target import Patch, Target, TargetConfig, TargetType


class AprilTagGridConfig(TargetConfig, frozen=True):
    """Ids grow to the right, then up from the bottom row (`id_order: top_left`: then down)."""

    type: Literal["apriltag_grid"] = "apriltag_grid"
    family: Family = "tag36h11"
    columns: int = Field(ge=1, description="tags side by side")
    rows: int = Field(ge=1, description="tags one above the other")
    tag_size_m: float = Field(gt=0, description="outer edge of a tag's black border")
    tag_gap_m: float | None = Field(default=None, gt=0, description="white between two tags")
    tag_spacing: float | None = Field(
        default=None, gt=0, description="gap / tag size, as Kalibr writes it"
    )
    first_id: int = Field(default=0, ge=0)
    id_order: Literal["bottom_left", "top_left"] = "bottom_left"
    border_cells: int = Field(
        default=1, ge=1, le=4, description="width of the black border in cells; Kalibr prints 2"
    )
    corner_squares: bool = Field(
        default=False, description="black squares between the tags' corners, as Kalibr prints"
    )

    @model_validator(mode="after")
    def _is_printable(self) -> AprilTagGridConfig:
        if (self.tag_gap_m is None) == (self.tag_spacing is None):
            found = "neither" if self.tag_gap_m is None else "both"
            raise ValueError(
                f"found {found} of tag_gap_m and tag_spacing; give exactly one of them "
                "(tag_spacing = tag_gap_m / tag_size_m)"
            )
        last, size = self.first_id + self.columns * self.rows - 1, TAGS_IN_FAMILY[self.family]
        if last >= size:
            raise ValueError(
                f"{self.columns} x {self.rows} tags from first_id {self.first_id} end with id "
                f"{last}, but {self.family} has ids 0 to {size - 1}; use fewer tags, a lower "
                "first_id or a larger family"
            )
        check_board_holds(self, self.pattern_m)
        return self

    @property
    def gap_m(self) -> float:
        """White between two tags."""
        if self.tag_gap_m is not None:
            return self.tag_gap_m
        return (self.tag_spacing or 0.0) * self.tag_size_m

    @property
    def pattern_m(self) -> tuple[float, float]:
        """Width and height of the print, with the corner squares if there are any."""
        gaps = 1 if self.corner_squares else -1
        pitch = self.tag_size_m + self.gap_m
        pad = gaps * self.gap_m
        return (self.columns * pitch + pad, self.rows * pitch + pad)


def _lower_left(config: AprilTagGridConfig) -> Array:
    """(rows, columns, 2) bottom-left corners of the tags, row 0 at the bottom."""
    pitch = config.tag_size_m + config.gap_m
    x = (np.arange(config.columns) - (config.columns - 1) / 2) * pitch + config.offset_m[0]
    y = (np.arange(config.rows) - (config.rows - 1) / 2) * pitch + config.offset_m[1]
    return np.stack(np.meshgrid(x, y), axis=-1) - config.tag_size_m / 2


def _corner_squares(config: AprilTagGridConfig, first: Array) -> list[Patch]:
    """Kalibr's squares of the gap's size that touch the tags' corners."""
    gap, pitch = config.gap_m, config.tag_size_m + config.gap_m
    return [
        Patch(rectangle(first[0] - gap + i * pitch, first[1] - gap + j * pitch, gap, gap), 0.0)
        for j in range(config.rows + 1)
        for i in range(config.columns + 1)
    ]


def build_apriltag_grid(name: str, config: TargetConfig) -> Target:
    """The target; `points` are the tags' outer border corners, four per tag in id order.

    Groups: `tag_ids` (n,), and `tag_corners` (n, 4) indices into `points`: bottom-left,
    bottom-right, top-right, top-left of each tag as seen on the upright print.
    """
    assert isinstance(config, AprilTagGridConfig)
    size = config.tag_size_m
    corner = _lower_left(config)
    if config.id_order == "top_left":
        corner = corner[::-1]
    corner = corner.reshape(-1, 2)
    ids = config.first_id + np.arange(len(corner), dtype=np.int64)
    points = (corner[:, None, :] + rectangle(0, 0, size, size)).reshape(-1, 2)
    patches = _corner_squares(config, corner.min(axis=0)) if config.corner_squares else []
    for tag_id, (left, bottom) in zip(ids.tolist(), corner.tolist(), strict=True):
        patches += tag_patches(config.family, tag_id, config.border_cells, left, bottom, size)
    return Target(
        name=name,
        config=config,
        outline=board_outline(config, config.pattern_m),
        points=np.column_stack([points, np.zeros(len(points))]),
        groups={"tag_ids": ids, "tag_corners": np.arange(4 * len(ids)).reshape(-1, 4)},
        patches=tuple(patches),
    )


APRILTAG_GRID = TargetType("apriltag_grid", AprilTagGridConfig, build_apriltag_grid)
