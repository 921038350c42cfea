"""A planar target: its outline, its fiducials at metric positions, and how it looks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from rigcal.geometry.bend import onto_bend
from rigcal.geometry.se3 import Array


class TargetConfig(BaseModel):
    """What every target in rig.yaml has; target types add their own fields.

    `width_m` and `height_m` are the board itself, as lasers see it; without them it ends where
    the printed pattern ends.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    type: str
    width_m: float | None = Field(default=None, gt=0, description="width of the board")
    height_m: float | None = Field(default=None, gt=0, description="height of the board")
    offset_m: tuple[float, float] = Field(
        default=(0.0, 0.0), description="centre of the pattern, from the centre of the board"
    )
    refine: tuple[Literal["scale", "bend"], ...] = Field(
        default=(),
        description="what is estimated together with the poses: the `scale` of the print, the "
        "`bend` of a board that is not flat",
    )


@dataclass(frozen=True, eq=False)
class Patch:
    """A black (grey 0) or white (grey 1) polygon of the print, (K, 2) in the target's frame, m."""

    polygon: Array
    grey: float


@dataclass(frozen=True, eq=False)
class Target:
    """A target as detectors, simulators and printers use it.

    Frame t: origin at the centre of the board's outline, x right, y up on the printed face, z out
    of the face towards the viewer. `outline` (4, 2) is the board, anticlockwise. `points` (N, 3)
    are the fiducial points (z = 0 if it is flat); a camera reports a corner by its index into them.
    `groups` names index arrays, for example the four corners of each tag (n_tags, 4) with the tag
    ids (n_tags,). `symmetries` are the permutations (N,) of `points`, other than the identity,
    under which the pattern looks the same: its pose is ambiguous by them.
    `patches` lists the print in painting order on white paper.
    `find` detects the fiducials in a grey uint8 image and returns point indices (M,) and pixels
    (M, 2); None when a sensor plugin knows the type itself.
    `bend` (3,) are the curvatures of a board that is not flat (`rigcal.geometry.bend`), 1/m.
    """

    name: str
    config: TargetConfig
    outline: Array
    points: Array
    groups: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)
    symmetries: tuple[NDArray[np.int64], ...] = ()
    patches: tuple[Patch, ...] = ()
    find: Callable[[NDArray[np.uint8]], tuple[NDArray[np.int64], Array]] | None = None
    bend: Array = field(default_factory=lambda: np.zeros(3))

    @property
    def may_bend(self) -> bool:
        """Whether it is bent, or is to be found out to be."""
        return "bend" in self.config.refine or bool(self.bend.any())

    def bent(self, bend: Array) -> Target:
        """The same board with another bend (3,), its `points` on the bent face."""
        bend = np.asarray(bend, np.float64)
        return replace(self, points=onto_bend(self.points, bend), bend=bend)

    @property
    def outline_points(self) -> Array:
        """(4, 3) corners of the board in its own frame."""
        return np.column_stack([self.outline, np.zeros(len(self.outline))])

    @property
    def size(self) -> Array:
        """(2,) width and height of the board."""
        result: Array = np.ptp(self.outline, axis=0)
        return result


@dataclass(frozen=True)
class TargetType:
    """A kind of target, handed over by a plugin: its `type:` name, config class and builder."""

    name: str
    config: type[TargetConfig]
    build: Callable[[str, TargetConfig], Target]
