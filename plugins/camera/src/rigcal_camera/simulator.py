"""Simulated images: what arrives at the lens from the board and from all that stands around it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.scene import Cylinder, Scene, Sphere, Surface
from rigcal_camera.board import face_of
from rigcal_camera.config import CameraConfig
from rigcal_camera.effects import DEFAULT_EFFECTS, CameraEffects, expose
from rigcal_camera.frames import Image
from rigcal_camera.hits import DARK, Hits, around, edges_of, hit_map
from rigcal_camera.lens import Lens, lens_of

FloatImage = NDArray[np.float32]
Thing = Surface | Cylinder | Sphere

BLACK, WHITE = 20.0, 230.0
"""Grey levels of black and white things at exposure 1: noise does not clip."""
SKY = 0.35
_EDGE_RAYS = 8
_MARGIN_PX = 2


@dataclass(frozen=True, eq=False)
class _Look:
    """A look at a scene: `rays` (H, W, 3) of the camera's frame, and what they hit (H, W)."""

    lens: Lens
    rays: FloatImage
    T_w_s: Array
    scene: Scene
    hits: Hits

    @property
    def things(self) -> tuple[Thing, ...]:
        """Thing k has number k + 1 in `hits`."""
        return (*self.scene.surfaces, *self.scene.solids)


def simulate(
    T_w_s: Array,
    scene: Scene,
    config: CameraConfig,
    rng: np.random.Generator,
    effects: CameraEffects = DEFAULT_EFFECTS,
) -> Image:
    """The grey image (H, W) that a camera at `T_w_s` takes of the scene."""
    light = arriving_light(T_w_s, scene, config, effects.board_px_per_mm)
    return expose(light, lens_of(config), effects, rng)


def arriving_light(
    T_w_s: Array, scene: Scene, config: CameraConfig, board_px_per_mm: float
) -> FloatImage:
    """What arrives at the lens (H, W), in grey levels; 0 where the lens does not reach.

    A pixel that shows one thing has the mean of its print, picture or colour over the pixel. A
    pixel in which things meet has the mean of 8 rays.
    """
    lens = lens_of(config)
    rays = _rays(lens)
    scene = _in_view(scene, T_w_s, lens)
    look = _Look(lens, rays, T_w_s, scene, hit_map(lens, rays, T_w_s, scene))
    plain = [0.0, SKY, 0.0, *(thing.grey for thing in look.things)]
    grey = np.array(plain, dtype=np.float32)[look.hits - DARK]
    face = _face(look, board_px_per_mm)
    np.copyto(grey, face, where=look.hits == 0)
    for number, thing in enumerate(look.things, start=1):
        if isinstance(thing, Surface) and thing.texture is not None:
            _draw_picture(grey, look, number, thing)
    _draw_edges(grey, look, face)
    light: FloatImage = np.float32(BLACK) + grey * np.float32(WHITE - BLACK)
    light[look.hits == DARK] = 0
    return light


@lru_cache(maxsize=8)
def _rays(lens: Lens) -> FloatImage:
    """Unit directions (H, W, 3) of all pixels; NaN where the lens sees nothing."""
    uv = np.stack(np.meshgrid(np.arange(lens.width), np.arange(lens.height)), axis=-1)
    rays = lens.rays_from_pixels(uv.reshape(-1, 2).astype(np.float64))
    return rays.reshape(lens.height, lens.width, 3).astype(np.float32)


def _in_view(scene: Scene, T_w_s: Array, lens: Lens) -> Scene:
    """The scene without what lies outside the cone of the lens's field of view."""

    def reaches_in(thing: Thing) -> bool:
        center, radius = thing.bounds
        p_s = se3.apply(se3.inverse(T_w_s), center)
        distance = float(np.linalg.norm(p_s))
        if distance <= radius:
            return True
        off_axis = np.arccos(p_s[2] / distance) - np.arcsin(radius / distance)
        return bool(off_axis <= _half_angle(lens))

    surfaces = tuple(surface for surface in scene.surfaces if reaches_in(surface))
    return replace(scene, surfaces=surfaces, solids=tuple(s for s in scene.solids if reaches_in(s)))


@lru_cache(maxsize=8)
def _half_angle(lens: Lens) -> float:
    """The largest angle (rad) between the optical axis and a pixel's ray."""
    return float(np.arccos(np.nanmin(_rays(lens)[..., 2])))


def _face(look: _Look, px_per_mm: float) -> FloatImage:
    """The board's print (H, W), in 0..1, at the pixels that show the board and those beside it."""
    face = np.zeros(look.hits.shape, dtype=np.float32)
    seen = look.hits == 0
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    if look.scene.T_w_t is not None and len(rows):
        region = tuple(
            slice(max(index[0] - _MARGIN_PX, 0), index[-1] + _MARGIN_PX + 1)
            for index in (rows, columns)
        )
        T_s_t = se3.inverse(look.T_w_s) @ look.scene.T_w_t
        face[region] = face_of(look.scene.target, T_s_t, look.rays[region], px_per_mm)
    return face


def _draw_picture(grey: FloatImage, look: _Look, number: int, surface: Surface) -> None:
    """The texture of a surface on the pixels that show it."""
    v, u = np.nonzero(look.hits == number)
    d_w = look.rays[v, u].astype(np.float64) @ look.T_w_s[:3, :3].T
    grey[v, u] = _met(surface, look, d_w, np.full(len(d_w), np.inf))[1]


def _met(thing: Thing, look: _Look, d_w: Array, limit: Array) -> tuple[Array, Array]:
    """Ranges (N,) at which rays from the camera meet a thing before `limit`, and its greys (N,)."""
    p_w = look.T_w_s[:3, 3]
    ranges = thing.meet(p_w, d_w, limit)
    greys = np.full(len(ranges), thing.grey)
    if isinstance(thing, Surface) and thing.texture is not None:
        hit = np.isfinite(ranges)
        p_f = se3.apply(se3.inverse(thing.T_w_f), p_w + ranges[hit, None] * d_w[hit])
        greys[hit] = thing.greys(p_f, ranges[hit] / min(look.lens.focal))
    return ranges, greys


def _draw_edges(grey: FloatImage, look: _Look, face: FloatImage) -> None:
    """The mean of 8 rays in every pixel in which things meet; the board has its pixel's mean.

    Only what the pixel or its neighbours show can be in it, so that few rays meet few things.
    """
    v, u = edges_of(look.hits)
    near = around(look.hits, v, u)
    d_w = _edge_rays(look.rays, v, u) @ look.T_w_s[:3, :3].T
    ranges = np.full(d_w.shape[:2], np.inf)
    greys = np.full(d_w.shape[:2], SKY)
    things: list[tuple[int, Thing]] = list(enumerate(look.things, start=1))
    if look.scene.T_w_t is not None:
        things.append((0, Surface(look.scene.T_w_t, look.scene.target.outline)))
    for number, thing in things:
        pixels = np.flatnonzero((near == number).any(axis=1))
        if not len(pixels):
            continue
        limit = ranges[pixels]
        found, shades = _met(thing, look, d_w[pixels].reshape(-1, 3), limit.ravel())
        if number == 0:
            shades = np.repeat(face[v[pixels], u[pixels]], _EDGE_RAYS)
        met = np.isfinite(found).reshape(limit.shape)
        ranges[pixels] = np.where(met, found.reshape(limit.shape), limit)
        greys[pixels] = np.where(met, shades.reshape(limit.shape), greys[pixels])
    grey[v, u] = greys.mean(axis=1)


def _edge_rays(rays: FloatImage, v: NDArray[np.intp], u: NDArray[np.intp]) -> Array:
    """Unit directions (N, 8, 3) in pixels: no two in the same eighth of a column or of a row."""
    height, width = rays.shape[:2]
    place = (np.arange(_EDGE_RAYS) + 0.5) / _EDGE_RAYS - 0.5
    across, down = place[[0, 1, 2, 3, 4, 5, 6, 7]], place[[0, 4, 2, 6, 1, 5, 3, 7]]
    middle = rays[v, u].astype(np.float64)
    left, right = np.maximum(u - 1, 0), np.minimum(u + 1, width - 1)
    above, below = np.maximum(v - 1, 0), np.minimum(v + 1, height - 1)
    by_u = (rays[v, right] - rays[v, left]) / (right - left)[:, None]
    by_v = (rays[below, u] - rays[above, u]) / (below - above)[:, None]
    steps = across[:, None] * by_u[:, None] + down[:, None] * by_v[:, None]
    directions = middle[:, None] + np.nan_to_num(steps)
    result: Array = directions / np.linalg.norm(directions, axis=2, keepdims=True)
    return result
