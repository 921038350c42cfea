"""The printed board as a picture with exact edges, and its area-averaged reductions."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry.se3 import Array
from rigcal.targets.target import Patch, Target
from rigcal_camera.frames import Image

_MAX_TEXELS = 8000
_MARGIN = 2


@dataclass(frozen=True, eq=False)
class Texture:
    """The board's face, row 0 at the top; level k is level 0 averaged over 2^k x 2^k texels.

    `origin` (2,) is the target-frame position of the top-left corner of the top-left texel,
    `texel_m` the width of a texel of level 0.
    """

    levels: tuple[Image, ...]
    origin: Array
    texel_m: float

    def reduced(self, texel_m: Array) -> Reduced:
        """The print averaged over texels of about `texel_m` (2,) along x and y, or level 0 where
        that is coarser.

        Texel i of width w has its centre at `origin + (i + 0.5) w` whatever its width, so that no
        reduction shifts an edge.
        """
        import cv2

        factor = np.maximum(texel_m / self.texel_m, 1.0)
        level = min(int(np.log2(factor.min())), len(self.levels) - 1)
        image = self.levels[level]
        size = np.array(image.shape[::-1])
        count = np.clip(np.round(size * 2**level / factor), 1, size).astype(int)
        width = size * 2**level * self.texel_m / count
        if (count < size).any():
            reduced = cv2.resize(image, count.tolist(), interpolation=cv2.INTER_AREA)
            image = np.asarray(reduced, dtype=np.uint8)
        scale = np.array([1.0, -1.0]) / width
        shift = -self.origin * scale - 0.5
        return Reduced(image.astype(np.float32), scale.astype(np.float32), shift.astype(np.float32))


@dataclass(frozen=True, eq=False)
class Reduced:
    """The board's face with wider texels: texel = scale * xy + shift, (2,) each."""

    image: NDArray[np.float32]
    scale: NDArray[np.float32]
    shift: NDArray[np.float32]

    def sample(self, xy: NDArray[np.float32]) -> NDArray[np.float32]:
        """Print (H, W) in 0..255 at target-frame positions (H, W, 2), interpolated between texels.

        H and W up to 32766.
        """
        import cv2

        column, row = (xy[..., i] * self.scale[i] + self.shift[i] for i in (0, 1))
        sampled = cv2.remap(
            self.image, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(sampled, dtype=np.float32)


_cache: WeakKeyDictionary[Target, dict[float, Texture]] = WeakKeyDictionary()


def texture_of(target: Target, px_per_mm: float) -> Texture:
    """The texture of a target, made once; at most 8000 texels along a side."""
    made = _cache.setdefault(target, {})
    if px_per_mm not in made:
        made[px_per_mm] = _render(target, 1e-3 / px_per_mm)
    return made[px_per_mm]


def _render(target: Target, texel: float) -> Texture:
    texel = max(texel, float(target.size.max()) / _MAX_TEXELS)
    low, high = target.outline.min(axis=0), target.outline.max(axis=0)
    columns, rows = np.ceil((high - low) / texel).astype(int) + 2 * _MARGIN
    origin = np.array([low[0], high[1]]) + np.array([-_MARGIN, _MARGIN]) * texel
    image = np.full((rows, columns), 255, dtype=np.uint8)
    for patch in target.patches:
        _paint(image, patch, origin, texel)
    return Texture(_reductions(image), origin, texel)


def _paint(image: Image, patch: Patch, origin: Array, texel: float) -> None:
    """Paints a convex polygon; border texels by the share that it covers.

    The share is the product over the edges of the clipped distance: exact for rectangles along
    the axes.
    """
    polygon = (patch.polygon - origin) * np.array([1.0, -1.0]) / texel
    low = np.maximum(np.floor(polygon.min(axis=0)).astype(int), 0)
    high = np.minimum(np.ceil(polygon.max(axis=0)).astype(int), image.shape[::-1])
    if (high <= low).any():
        return
    x = np.arange(low[0], high[0], dtype=np.float32)[None, :] + np.float32(0.5)
    y = np.arange(low[1], high[1], dtype=np.float32)[:, None] + np.float32(0.5)
    share_x, share_y, share = np.ones_like(x), np.ones_like(y), np.ones((1, 1), np.float32)
    for (start_x, start_y), (end_x, end_y) in zip(polygon, np.roll(polygon, -1, 0), strict=True):
        dx, dy = np.array([end_x - start_x, end_y - start_y]) / np.hypot(
            end_x - start_x, end_y - start_y
        )
        # Anticlockwise seen with y up is clockwise with y down: the inside is on the right.
        if abs(dx) < 1e-9:
            share_x = share_x * np.clip(dy * (x - start_x) + 0.5, 0, 1).astype(np.float32)
        elif abs(dy) < 1e-9:
            share_y = share_y * np.clip(dx * (start_y - y) + 0.5, 0, 1).astype(np.float32)
        else:
            inside = dy * (x - start_x) + dx * (start_y - y)
            share = share * np.clip(inside + 0.5, 0, 1).astype(np.float32)
    cover = share_x * share_y * share
    area = image[low[1] : high[1], low[0] : high[0]]
    area[...] = np.round(area + cover * (255 * patch.grey - area.astype(np.float32)))


def _reductions(image: Image) -> tuple[Image, ...]:
    import cv2

    levels = [image]
    while min(levels[-1].shape) > 8:
        last = levels[-1]
        last = np.pad(last, [(0, size % 2) for size in last.shape], mode="edge")
        height, width = last.shape
        half = cv2.resize(last, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
        levels.append(np.asarray(half, dtype=np.uint8))
    return tuple(levels)
