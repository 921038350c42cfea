"""What a scenario may say of a simulated camera, and how the light becomes an image by it."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from rigcal.plugin import Effects
from rigcal_camera.frames import Image
from rigcal_camera.lens import Lens


class CameraEffects(Effects, frozen=True):
    """What happens between the light and the message; also the resolution of the board's image."""

    blur_px: float = Field(default=0.6, ge=0, description="blur of the lens, sigma")
    vignetting: float = Field(
        default=0.0, ge=0, le=1, description="share of the light that the far corner loses"
    )
    exposure: float = Field(
        default=1.0, gt=0, description="factor on the light; what exceeds 255 is clipped"
    )
    noise_grey: float = Field(default=2.0, ge=0, description="noise in the dark, of 255, sigma")
    electrons_per_grey: float | None = Field(
        default=None, gt=0, description="adds shot noise: electrons that make one grey level"
    )
    encoding: Literal["mono8", "rgb8", "bgr8"] = Field(
        default="mono8", description="of the images; colour has three equal channels"
    )
    jpeg_quality: int | None = Field(
        default=None, ge=1, le=100, description="send CompressedImage messages of this quality"
    )
    board_px_per_mm: float = Field(
        default=3.0, gt=0, description="resolution at which the board's print is drawn"
    )


DEFAULT_EFFECTS = CameraEffects()


def expose(
    light: NDArray[np.float32], lens: Lens, effects: CameraEffects, rng: np.random.Generator
) -> Image:
    """The image (H, W) that the sensor makes of `light` (H, W), which is in grey levels.

    Blur, vignetting and exposure, then noise of variance `noise_grey^2 + grey /
    electrons_per_grey` (EMVA 1288: shot noise is that of the electrons), saturation, rounding.
    """
    import cv2

    image = np.array(light, dtype=np.float32)
    if effects.blur_px > 0:
        cv2.GaussianBlur(image, (0, 0), effects.blur_px, image, borderType=cv2.BORDER_REPLICATE)
    if effects.exposure != 1:
        image *= np.float32(effects.exposure)
    if effects.vignetting > 0:
        image *= _transmission(lens, effects.vignetting)
    sigma = _noise(image, effects)
    if sigma is not None:
        image += sigma * rng.standard_normal(image.shape, dtype=np.float32)
    # convertScaleAbs rounds and saturates in one pass, but takes the absolute value.
    return np.asarray(cv2.convertScaleAbs(np.maximum(image, 0, out=image)), dtype=np.uint8)


def _transmission(lens: Lens, loss: float) -> NDArray[np.float32]:
    """Share of the light (H, W) that arrives: falls with the squared distance from the axis."""
    u = (np.arange(lens.width, dtype=np.float32) - np.float32(lens.principal[0])) ** 2
    v = (np.arange(lens.height, dtype=np.float32) - np.float32(lens.principal[1])) ** 2
    farthest = max(u[0], u[-1]) + max(v[0], v[-1])
    share: NDArray[np.float32] = 1 - np.float32(loss) * (v[:, None] + u) / farthest
    return share


def _noise(
    image: NDArray[np.float32], effects: CameraEffects
) -> NDArray[np.float32] | np.float32 | None:
    """Standard deviation of each pixel's noise; None: there is none."""
    if effects.electrons_per_grey is not None:
        shot = np.maximum(image, 0) / np.float32(effects.electrons_per_grey)
        return np.sqrt(shot + np.float32(effects.noise_grey**2))
    return np.float32(effects.noise_grey) if effects.noise_grey > 0 else None
