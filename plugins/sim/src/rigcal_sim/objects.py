"""Things that a scenario file adds to the world: pictures, boxes, cylinders, spheres, decoys."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal_sim.section import Interval, Section, Triple

Length = Annotated[float, Field(gt=0)]


class _Object(Section):
    grey: float = Field(default=0.5, ge=0, le=1, description="0 black, 1 white")


class _Placed(_Object):
    """Something that stands still at a place in the world."""

    translation_m: Triple = Field(description="its middle in the world, z up")
    rpy_deg: Triple = (0.0, 0.0, 0.0)

    @property
    def T_w_o(self) -> Array:
        """(4, 4) pose in the world."""
        R = se3.rotation_from_rpy(np.radians(self.rpy_deg))
        return se3.transform(R, np.array(self.translation_m))


class RectangleConfig(_Placed):
    """A flat rectangle. Unrotated it stands upright and faces along the world's x axis."""

    shape: Literal["rectangle"]
    size_m: tuple[Length, Length] = Field(description="width and height")
    texture: Path | None = Field(
        default=None, description="image file on it, beside the scenario; drawn in grey"
    )


class BoxConfig(_Placed):
    """A box; its sides are parallel to the world's axes before it is rotated."""

    shape: Literal["box"]
    size_m: tuple[Length, Length, Length] = Field(description="along x, y and z")


class CylinderConfig(_Placed):
    """A closed cylinder; upright before it is rotated."""

    shape: Literal["cylinder"]
    radius_m: float = Field(gt=0)
    height_m: float = Field(gt=0)


class SphereConfig(_Placed):
    """A ball."""

    shape: Literal["sphere"]
    radius_m: float = Field(gt=0)


class DecoyConfig(_Object):
    """A blank board of the target's outline, put somewhere else in every exposure.

    It stands at a random bearing to the left or right of the target's, as high as the target, and
    faces the world's z axis but for random rotations about its three axes.
    """

    shape: Literal["decoy"]
    beside_deg: Interval = Field(default=(50.0, 120.0), description="bearing from the target's")
    radius_m: Interval = Field(default=(1.5, 2.5), description="from the world's z axis")
    max_angle_deg: float = Field(default=25.0, ge=0, le=80, description="roll, pitch and yaw")

    @model_validator(mode="after")
    def _intervals_are_ordered(self) -> DecoyConfig:
        for name, (low, high), most in (
            ("beside_deg", self.beside_deg, 180.0),
            ("radius_m", self.radius_m, np.inf),
        ):
            if not 0 < low <= high <= most:
                limit = f"at most {most:g}" if most < np.inf else "any number"
                raise ValueError(
                    f"{name} is [{low:g}, {high:g}]; write [lowest, highest], above 0 and {limit}"
                )
        return self


ObjectConfig = Annotated[
    RectangleConfig | BoxConfig | CylinderConfig | SphereConfig | DecoyConfig,
    Field(discriminator="shape"),
]


def with_textures_in(folder: Path, objects: Sequence[ObjectConfig]) -> tuple[ObjectConfig, ...]:
    """The same objects, the names of their textures being relative to `folder`."""
    return tuple(
        thing.model_copy(update={"texture": folder / thing.texture})
        if isinstance(thing, RectangleConfig) and thing.texture is not None
        else thing
        for thing in objects
    )


def unreadable_textures(objects: Sequence[ObjectConfig]) -> Iterator[tuple[int, str]]:
    """Index and reason of every object whose texture cannot be read."""
    for index, thing in enumerate(objects):
        if isinstance(thing, RectangleConfig) and thing.texture is not None:
            try:
                read_texture(thing.texture)
            except (OSError, ValueError) as error:
                reason = getattr(error, "strerror", None) or str(error)
                yield (
                    index,
                    (
                        f"cannot read '{thing.texture}': {reason}; give the path of a PNG or JPEG "
                        "image, relative to the scenario file"
                    ),
                )


@lru_cache(maxsize=16)
def read_texture(path: Path) -> NDArray[np.uint8]:
    """Grey image (H, W) of a file; OSError or ValueError if there is none in it."""
    import cv2

    data = np.frombuffer(path.read_bytes(), np.uint8)
    image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if len(data) else None
    if image is None:
        raise ValueError("it holds no image")
    return np.asarray(image, np.uint8)
