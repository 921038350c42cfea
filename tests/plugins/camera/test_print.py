"""The print of the board in simulated images against brute force, corner by corner."""

import cv2
import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal.scene import Scene
from rigcal_camera import lens_of
from rigcal_camera.simulator import BLACK, WHITE, arriving_light

LENSES = {
    "plain": {},
    "barrel": {"distortion": (-0.28, 0.08, 0.0005, -0.0004)},
    "fisheye": {"model": "fisheye", "distortion": (-0.054, -0.078, 0.096, -0.0515)},
}
HALF, RAYS, STEP = 4, 987, 610
WINDOW = np.stack(np.meshgrid(*[np.arange(-HALF, HALF + 1)] * 2), axis=-1).reshape(-1, 1, 2)
INDEX = np.arange(RAYS)
SPREAD = (np.stack([INDEX, INDEX * STEP % RAYS], axis=1) + 0.5) / RAYS - 0.5
PICK = 4


def printed_grey(target, xy):
    """Grey of the print at (N, 2) points, exactly: the cells between all edges of its patches."""
    edges = [np.unique(np.concatenate([p.polygon[:, i] for p in target.patches])) for i in (0, 1)]
    cells = np.ones((len(edges[0]) + 1, len(edges[1]) + 1))
    for patch in target.patches:
        low, high = patch.polygon.min(axis=0), patch.polygon.max(axis=0)
        (i0, i1), (j0, j1) = (
            np.searchsorted(e, (a, b)) for e, a, b in zip(edges, low, high, strict=True)
        )
        cells[i0 + 1 : i1 + 1, j0 + 1 : j1 + 1] = patch.grey
    return cells[np.searchsorted(edges[0], xy[:, 0]), np.searchsorted(edges[1], xy[:, 1])]


def by_brute_force(target, T_s_t, lens, pixel):
    """The print (9, 9) around a pixel by 987 rays in each, and whether all is on the board."""
    T_t_s = se3.inverse(T_s_t)
    rays = lens.rays_from_pixels((pixel + WINDOW + SPREAD).reshape(-1, 2).astype(np.float64))
    d_t = rays @ T_t_s[:3, :3].T
    xy = T_t_s[:2, 3] - T_t_s[2, 3] / d_t[:, 2:] * d_t[:, :2]
    on_board = (np.abs(xy) < target.size / 2 - 0.01).all()
    grey = printed_grey(target, xy).reshape(len(WINDOW), RAYS).mean(axis=1)
    return BLACK + grey.reshape(2 * HALF + 1, -1) * (WHITE - BLACK), on_board


def shift(image, reference):
    """By how many pixels (2,) the image lies beside the reference (least squares), both blurred."""
    a, b = (cv2.GaussianBlur(x.astype(np.float64), (0, 0), 0.6) for x in (image, reference))
    inner = np.s_[1:-1, 1:-1]
    slopes = np.column_stack([slope[inner].ravel() for slope in np.gradient(b)[::-1]])
    return -np.linalg.lstsq(slopes, (a - b)[inner].ravel())[0]


@pytest.mark.parametrize("lens_name", LENSES)
@pytest.mark.parametrize("kind", ["april", "chess"])
def test_every_corner_is_where_it_is_printed_at_all_distances(kind, lens_name, board, camera, pose):
    """Near and far, upright and turned: below 0.02 px, also where a tag's cell is 2 px wide."""
    target, config = board[kind], camera(**LENSES[lens_name])
    lens, count = lens_of(config), 0
    last = np.array([lens.width, lens.height]) - HALF - 2
    for distance_m in (0.6, 1.3, 4.0):
        for rpy_deg in ((0, 0, 0), (-12, -40, 20), (30, 20, 45)):
            T_s_t = pose(rpy_deg, (0.031 * distance_m, -0.017 * distance_m, distance_m))
            light = arriving_light(np.eye(4), Scene(target, T_s_t), config, 3.0)
            p_s = se3.apply(T_s_t, target.points)
            uv = lens.pixels_from_points(p_s)[0][lens.sees(p_s)]
            inside = ((uv > HALF + 1) & (uv < last)).all(axis=1)
            for u, v in np.round(uv[inside]).astype(int)[:: max(inside.sum() // PICK, 1)]:
                reference, on_board = by_brute_force(target, T_s_t, lens, np.array([u, v]))
                if on_board:
                    drawn = light[v - HALF : v + HALF + 1, u - HALF : u + HALF + 1]
                    assert np.abs(shift(drawn, reference)).max() < 0.02
                    count += 1
    assert count >= 20
