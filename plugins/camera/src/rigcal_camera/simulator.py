"""Simulated grey images: the printed board through the lens, in front of plain surfaces."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.scene import Scene, Surface
from rigcal_camera.config import CameraConfig
from rigcal_camera.effects import DEFAULT_EFFECTS, CameraEffects, expose
from rigcal_camera.frames import Image
from rigcal_camera.lens import Lens, lens_of
from rigcal_camera.texture import texture_of

FloatImage = NDArray[np.float32]

_BLACK, _WHITE = 20.0, 230.0
"""Grey of black and white surfaces: noise does not clip."""
_SUBSAMPLES = 3
_COARSE_PX = 8
_SKY = 0.35
_OUTLINE_STEPS = 24
_MARGIN_PX = 2
_MAX_BACKGROUNDS = 32

_backgrounds: OrderedDict[tuple[object, ...], FloatImage] = OrderedDict()


def simulate(
    T_w_s: Array,
    scene: Scene,
    config: CameraConfig,
    rng: np.random.Generator,
    effects: CameraEffects = DEFAULT_EFFECTS,
) -> Image:
    """The grey image (H, W) that a camera at `T_w_s` takes of the scene.

    Each pixel of the board's region is the mean of 3 x 3 rays through the lens that meet the
    printed face in its area-averaged texture; nearer surfaces hide it; `expose` adds the effects.
    The other surfaces are drawn at an eighth of the resolution: they carry no corners.
    """
    light: FloatImage = _background(T_w_s, scene, config).copy()
    if scene.T_w_t is not None:
        _draw_board(light, T_w_s, scene, config, effects)
    return expose(light, lens_of(config), effects, rng)


def _grey(level: NDArray[Any]) -> FloatImage:
    return (_BLACK + level * (_WHITE - _BLACK)).astype(np.float32)


@lru_cache(maxsize=8)
def _rays(lens: Lens) -> FloatImage:
    """Unit directions (H, W, 3) of all pixels; NaN where the lens sees nothing."""
    uv = np.stack(np.meshgrid(np.arange(lens.width), np.arange(lens.height)), axis=-1)
    rays = lens.rays_from_pixels(uv.reshape(-1, 2).astype(np.float64))
    return rays.reshape(lens.height, lens.width, 3).astype(np.float32)


def _background(T_w_s: Array, scene: Scene, config: CameraConfig) -> FloatImage:
    """Grey of everything but the board (H, W), at reduced resolution; kept for still scenes."""
    import cv2

    lens = lens_of(config)
    key = (lens, T_w_s.tobytes(), *map(_surface_key, scene.surfaces))
    if key in _backgrounds:
        _backgrounds.move_to_end(key)
        return _backgrounds[key]
    u = np.arange(0, lens.width + _COARSE_PX, _COARSE_PX)
    v = np.arange(0, lens.height + _COARSE_PX, _COARSE_PX)
    directions = lens.rays_from_pixels(np.stack(np.meshgrid(u, v), -1).reshape(-1, 2).astype(float))
    seen = np.isfinite(directions[:, 0])
    _, hit = replace(scene, T_w_t=None).cast(T_w_s[:3, 3], directions[seen] @ T_w_s[:3, :3].T)
    greys = np.array([_SKY, 0.0, *(surface.grey for surface in scene.surfaces)])
    coarse = np.zeros(len(directions), dtype=np.float32)
    coarse[seen] = _grey(greys[hit + 1])
    enlarged = cv2.warpAffine(
        coarse.reshape(len(v), len(u)),
        np.array([[1 / _COARSE_PX, 0, 0], [0, 1 / _COARSE_PX, 0]]),
        (lens.width, lens.height),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
    )
    background: FloatImage = np.asarray(enlarged, dtype=np.float32)
    _backgrounds[key] = background
    if len(_backgrounds) > _MAX_BACKGROUNDS:
        _backgrounds.popitem(last=False)
    return background


def _surface_key(surface: Surface) -> tuple[object, ...]:
    return (surface.T_w_f.tobytes(), surface.polygon.tobytes(), surface.grey)


def _draw_board(
    image: FloatImage, T_w_s: Array, scene: Scene, config: CameraConfig, effects: CameraEffects
) -> None:
    assert scene.T_w_t is not None
    lens = lens_of(config)
    T_s_t = se3.inverse(T_w_s) @ scene.T_w_t
    region = _region(lens, T_s_t, scene.target.outline_points, _MARGIN_PX)
    if region is None:
        return
    rows, columns = region
    rays = _rays(lens)[rows, columns]
    face, cover = _board(rays, T_s_t, scene, effects.board_px_per_mm)
    visible = _unoccluded(rays, T_w_s, scene)
    if visible is not None:
        cover = cover * visible
    patch = image[rows, columns]
    patch += cover * (_grey(face / np.float32(255)) - patch)


def _region(lens: Lens, T_s_t: Array, outline: Array, margin: int) -> tuple[slice, slice] | None:
    """Rows and columns of the image that the board can touch."""
    share = np.linspace(0, 1, _OUTLINE_STEPS)[:, None, None]
    grid = outline[0] + share * (outline[1] - outline[0])
    grid = grid + share.swapaxes(0, 1) * (outline[3] - outline[0])
    p_s = se3.apply(T_s_t, grid.reshape(-1, 3))
    uv, _, valid = lens.pixels_from_points(p_s)
    angle = np.arctan2(np.hypot(p_s[:, 0], p_s[:, 1]), p_s[:, 2])
    valid &= angle <= lens.max_angle
    if not valid.any():
        return None
    touched = uv[valid]
    if not valid.all():
        # The board reaches out of the lens's field: how far is not in the points projected.
        touched = np.concatenate([touched, _pixels_near_board(lens, T_s_t, outline[:, :2])])
    low, high = touched.min(axis=0) - margin, touched.max(axis=0) + margin
    low = np.clip(np.floor(low), 0, [lens.width, lens.height]).astype(int)
    high = np.clip(np.ceil(high) + 1, 0, [lens.width, lens.height]).astype(int)
    if (high <= low).any():
        return None
    return slice(low[1], high[1]), slice(low[0], high[0])


def _pixels_near_board(lens: Lens, T_s_t: Array, outline: Array) -> Array:
    """Corners (N, 2) of the coarse cells whose middle meets the board."""
    step = np.arange(-1, max(lens.width, lens.height) // _COARSE_PX + 2) * _COARSE_PX
    u, v = step[step <= lens.width + _COARSE_PX], step[step <= lens.height + _COARSE_PX]
    uv = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2).astype(np.float64)
    xy = _plane_points(lens.rays_from_pixels(uv), se3.inverse(T_s_t))
    hit = uv[_inset(xy, outline) >= 0]
    return np.concatenate([hit - _COARSE_PX, hit + _COARSE_PX])


def _plane_points(rays: Array, T_t_s: Array) -> FloatImage:
    """Where rays (..., 3) meet the board's plane, (..., 2) in its frame; 1 km off if nowhere."""
    origin = T_t_s[:3, 3]
    d_t = rays @ T_t_s[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        t = -origin[2] / d_t[..., 2]
        xy = origin[:2] + t[..., None] * d_t[..., :2]
    xy[~(t > 0)] = 1e6
    # Within reach of the board's size: the maps made from this are 32-bit.
    near: FloatImage = np.clip(xy, -1e3, 1e3).astype(np.float32)
    return near


def _board(
    rays: FloatImage, T_s_t: Array, scene: Scene, px_per_mm: float
) -> tuple[FloatImage, FloatImage]:
    """Print (H, W) in 0..255 and share of each pixel that the board covers (H, W)."""
    import cv2

    height, width = rays.shape[:2]
    T_t_s = se3.inverse(T_s_t)
    xy = _plane_points(rays.astype(np.float64), T_t_s)
    fine, shrink = (width * _SUBSAMPLES, height * _SUBSAMPLES), (width, height)
    inset = cv2.resize(_inset(xy, scene.target.outline), fine, interpolation=cv2.INTER_LINEAR)
    covered = (np.asarray(inset) >= 0).astype(np.uint8)
    cover = np.asarray(cv2.resize(covered * np.uint8(255), shrink, interpolation=cv2.INTER_AREA))
    if T_t_s[2, 3] <= 0:
        return np.full((height, width), 255, dtype=np.float32), cover / np.float32(255)
    fine_xy = np.asarray(cv2.resize(xy, fine, interpolation=cv2.INTER_LINEAR), np.float32)
    face = texture_of(scene.target, px_per_mm).sample(fine_xy, _footprint(xy, scene) / _SUBSAMPLES)
    # Beyond the board's edge the texture goes on, so that its mean needs no weights.
    mean = cv2.resize(face, shrink, interpolation=cv2.INTER_AREA)
    return np.asarray(mean, np.float32), cover / np.float32(255)


def _inset(xy: FloatImage, outline: Array) -> FloatImage:
    """Distance (m) of (..., 2) points from the nearest edge line, positive inside the board."""
    x, y = np.ascontiguousarray(xy[..., 0]), np.ascontiguousarray(xy[..., 1])
    inset = np.full(x.shape, np.inf, dtype=np.float32)
    for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        dx, dy = ((end - start) / np.linalg.norm(end - start)).tolist()
        np.minimum(inset, dx * y - dy * x + (dy * start[0] - dx * start[1]), out=inset)
    return inset


def _footprint(xy: FloatImage, scene: Scene) -> float:
    """Smaller side (m) of a pixel's patch of the board, its median over the board."""
    across = np.linalg.norm(np.diff(xy, axis=1)[:-1], axis=2)
    down = np.linalg.norm(np.diff(xy, axis=0)[:, :-1], axis=2)
    inside = _inset(xy[:-1, :-1], scene.target.outline) >= 0
    if not inside.any():
        return 0.0
    return float(min(np.median(across[inside]), np.median(down[inside])))


def _unoccluded(rays: FloatImage, T_w_s: Array, scene: Scene) -> FloatImage | None:
    """Which pixels (H, W) show no surface before the board; None: there is none."""
    assert scene.T_w_t is not None
    outline = se3.apply(scene.T_w_t, scene.target.outline_points)
    T_t_w = se3.inverse(scene.T_w_t)
    side = float(np.sign(se3.apply(T_t_w, T_w_s[:3, 3])[2]))
    between = []
    for surface in scene.surfaces:
        corners = np.column_stack([surface.polygon, np.zeros(len(surface.polygon))])
        p_w = se3.apply(surface.T_w_f, corners)
        T_f_w = se3.inverse(surface.T_w_f)
        camera, board = se3.apply(T_f_w, T_w_s[:3, 3])[2], se3.apply(T_f_w, outline)[:, 2]
        before = (se3.apply(T_t_w, p_w)[:, 2] * side > 0).any()
        if before and (board * camera < 0).any():
            between.append(surface)
    if not between:
        return None
    directions = rays.reshape(-1, 3).astype(np.float64) @ T_w_s[:3, :3].T
    directions = np.nan_to_num(directions)
    _, hit = replace(scene, surfaces=tuple(between)).cast(T_w_s[:3, 3], directions)
    return (hit <= 0).astype(np.float32).reshape(rays.shape[:2])
