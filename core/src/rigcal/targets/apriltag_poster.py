"""`apriltag_poster`: AprilTags of any size and id at metric positions on a sheet."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from rigcal.geometry.se3 import Array
from rigcal.targets.apriltag import TAGS_IN_FAMILY, Family, tag_patches
from rigcal.targets.printed import board_outline, rectangle
from rigcal.targets.target import Patch, Target, TargetConfig, TargetType

_ROUNDING_M = 1e-9


class PosterTag(BaseModel):
    """One tag; positions are those of its centre from the centre of the sheet, x right, y up."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    id: int = Field(ge=0)
    x_m: float = Field(description="centre of the tag, to the right of the sheet's centre")
    y_m: float = Field(description="centre of the tag, above the sheet's centre")
    size_m: float = Field(gt=0, description="outer edge of the tag's black border")
    turn_deg: float = Field(default=0.0, description="turned anticlockwise on the print")

    @property
    def name(self) -> str:
        """The tag in a message."""
        return f"tag {self.id} at ({self.x_m:.4g}, {self.y_m:.4g}) m"


class AprilTagPosterConfig(TargetConfig, frozen=True):
    """`offset_m` moves all tags together."""

    type: Literal["apriltag_poster"] = "apriltag_poster"
    family: Family = "tag36h11"
    width_m: float = Field(gt=0, description="width of the sheet")
    height_m: float = Field(gt=0, description="height of the sheet")
    tags: tuple[PosterTag, ...] = Field(
        description="two or more, as one alone does not show how it is turned",
        json_schema_extra={"minItems": 2},
    )

    @model_validator(mode="after")
    def _is_printable(self) -> AprilTagPosterConfig:
        if len(self.tags) < 2:
            raise ValueError(
                f"found {len(self.tags)}, expected two or more tags: one alone does not show a "
                "camera how it is turned"
            )
        _check_ids([tag.id for tag in self.tags], self.family)
        corners = tag_corners(self)
        _check_sheet_holds(self, corners)
        _check_apart(self.tags, corners)
        return self


def tag_corners(config: AprilTagPosterConfig) -> Array:
    """(n, 4, 2) bottom-left, bottom-right, top-right, top-left of each tag in its own upright."""
    turn = _turns(config)
    centre = np.array([[tag.x_m, tag.y_m] for tag in config.tags]) + config.offset_m
    size = np.array([tag.size_m for tag in config.tags])
    upright = rectangle(-0.5, -0.5, 1.0, 1.0) * size[:, None, None]
    result: Array = upright @ turn.swapaxes(1, 2) + centre[:, None]
    return result


def _turns(config: AprilTagPosterConfig) -> Array:
    """(n, 2, 2) rotations of the tags; quarter turns are exact."""
    quarters, rest = np.divmod([tag.turn_deg for tag in config.tags], 90.0)
    c, s = np.cos(np.radians(rest)), np.sin(np.radians(rest))
    turn = np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], axis=-2)
    exact = np.array([[[1, 0], [0, 1]], [[0, -1], [1, 0]], [[-1, 0], [0, -1]], [[0, 1], [-1, 0]]])
    result: Array = exact[quarters.astype(int) % 4] @ turn
    return result


def _check_ids(ids: list[int], family: str) -> None:
    size = TAGS_IN_FAMILY[family]
    if twice := sorted({i for i in ids if ids.count(i) > 1}):
        raise ValueError(
            f"several tags have the id {', '.join(map(str, twice))}; every tag needs its own id"
        )
    if max(ids) >= size:
        raise ValueError(
            f"id {max(ids)} found, but {family} has ids 0 to {size - 1}; use a lower id or a "
            "larger family"
        )


def _check_sheet_holds(config: AprilTagPosterConfig, corners: Array) -> None:
    half = np.array([config.width_m, config.height_m]) / 2
    beyond = (np.abs(corners) - half).max(axis=(1, 2))
    worst = int(np.argmax(beyond))
    if beyond[worst] > _ROUNDING_M:
        raise ValueError(
            f"{config.tags[worst].name} reaches over the sheet's edge by {beyond[worst]:.4g} m; "
            f"the sheet ends {half[0]:.4g} m to the sides of its centre (width_m / 2) and "
            f"{half[1]:.4g} m above and below it (height_m / 2), where x_m and y_m count from"
        )


def _check_apart(tags: tuple[PosterTag, ...], corners: Array) -> None:
    import shapely

    squares = [shapely.Polygon(square) for square in corners]
    first, second = shapely.STRtree(squares).query(squares, "dwithin", _ROUNDING_M)
    for i, j in zip(first.tolist(), second.tolist(), strict=True):
        if i < j:
            raise ValueError(
                f"{tags[i].name} and {tags[j].name} overlap or touch; leave white between them, "
                "best one cell of the larger tag or more"
            )


def build_apriltag_poster(name: str, config: TargetConfig) -> Target:
    """The target; `points` are the tags' outer border corners, four per tag in the file's order.

    Groups as those of `apriltag_grid`: `tag_ids` (n,), and `tag_corners` (n, 4) indices into
    `points`: bottom-left, bottom-right, top-right, top-left of each tag in its own upright.
    """
    assert isinstance(config, AprilTagPosterConfig)
    corners = tag_corners(config)
    patches = []
    for tag, turn, square in zip(config.tags, _turns(config), corners, strict=True):
        upright = tag_patches(config.family, tag.id, 1, 0.0, 0.0, tag.size_m)
        patches += [Patch(p.polygon @ turn.T + square[0], p.grey) for p in upright]
    points = corners.reshape(-1, 2)
    return Target(
        name=name,
        config=config,
        outline=board_outline(config, (config.width_m, config.height_m)),
        points=np.column_stack([points, np.zeros(len(points))]),
        groups={
            "tag_ids": np.array([tag.id for tag in config.tags], dtype=np.int64),
            "tag_corners": np.arange(len(points)).reshape(-1, 4),
        },
        patches=tuple(patches),
    )


APRILTAG_POSTER = TargetType("apriltag_poster", AprilTagPosterConfig, build_apriltag_poster)
