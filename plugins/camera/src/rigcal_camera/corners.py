"""What the finders of all kinds of target share: labelled corners, sub-pixel refinement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry.se3 import Array
from rigcal_camera.frames import Image


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners of one image: indices into `target.points` (M,) and pixels (M, 2).

    Without corners, `reason` says why.
    """

    index: NDArray[np.int64]
    uv: Array
    reason: str = ""

    def __len__(self) -> int:
        return len(self.index)


def no_corners(reason: str) -> Corners:
    """Nothing found."""
    return Corners(np.zeros(0, dtype=np.int64), np.zeros((0, 2)), reason)


def refine_saddles(image: Image, uv: Array, window: Array) -> Array:
    """Saddle points (M, 2) near `uv` by `cv2.cornerSubPix`, with half windows (M,) [px].

    Those outside the image stay as they are. Only for checkerboard corners: at the L corners of
    bare tags it is worse than no refinement.
    """
    import cv2

    size = np.clip(np.round(window), 2, 15).astype(int)
    refined = np.array(uv, dtype=np.float64)
    inside = ((uv >= 0) & (uv <= np.array(image.shape[::-1]) - 1)).all(axis=1)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
    for half in np.unique(size):
        chosen = inside & (size == half)
        if not chosen.any():
            continue
        start = np.ascontiguousarray(uv[chosen], dtype=np.float32).reshape(-1, 1, 2)
        found = cv2.cornerSubPix(image, start, (int(half), int(half)), (-1, -1), criteria)
        refined[chosen] = found.reshape(-1, 2)
    return refined


def sample(image: Image, uv: Array) -> Array:
    """Grey values (n, ...) at pixels (n, ..., 2), bilinear; the border's outside the image."""
    import cv2

    flat = np.asarray(uv, dtype=np.float32).reshape(len(uv), -1, 2)
    u, v = np.ascontiguousarray(flat[..., 0]), np.ascontiguousarray(flat[..., 1])
    grey = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    result: Array = np.asarray(grey, dtype=np.float64).reshape(uv.shape[:-1])
    return result
