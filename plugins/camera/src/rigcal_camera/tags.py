"""Corners of AprilTag boards: bare tags by the AprilTag library, Kalibr's by completion."""

from __future__ import annotations

from functools import lru_cache
from threading import get_ident
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.targets.target import Target
from rigcal_camera.corners import Corners, no_corners, refine_saddles, sample
from rigcal_camera.edges import refine_by_edges
from rigcal_camera.frames import Image
from rigcal_camera.lens import Lens
from rigcal_camera.pose import PoseFit, fit_poses, homography_inliers

_MIN_TAGS = 2
_MIN_MARGIN = 10.0
_MAX_HAMMING = 1
_COARSE_PX = 40.0
_COMPLETION_ROUNDS = 8
_SETTLED_PX = 0.05

Tags = tuple[NDArray[np.int64], Array]
"""Ids (n,) and corners (n, 4, 2), anticlockwise as seen, from an unknown first corner."""


def find_tag_corners(image: Image, target: Target, lens: Lens) -> Corners:
    """Corners of every tag of the target found in the image."""
    config: Any = target.config
    family = getattr(config, "family", "tag36h11")
    border_cells = getattr(config, "border_cells", 1)
    saddles = getattr(config, "corner_squares", False)
    if border_cells == 1 and not saddles:
        ids, uv = _bare_tags(image, family, target)
    else:
        ids, uv = _aruco_tags(image, family, border_cells)
    if not saddles and len(ids):
        cell = 1 / (_code_cells(family) + 2 * border_cells)
        uv = refine_by_edges(image, uv, lens, cell)
    corners = _labelled(ids, uv, target, lens)
    if saddles and len(corners):
        return _completed(image, corners, target, lens)
    return corners


def _labelled(ids: NDArray[np.int64], uv: Array, target: Target, lens: Lens) -> Corners:
    """Corners of the target's own tags, with the first corner found from the board's geometry.

    Libraries print a tag's code turned by multiples of 90 degrees against each other: of the four
    turns, the one with which the tags together lie as on the board is right.
    """
    tag_ids, tag_corners = target.groups["tag_ids"], target.groups["tag_corners"]
    place = {int(tag_id): row for row, tag_id in enumerate(tag_ids)}
    known = np.array([int(i) in place for i in ids], dtype=bool)
    if known.sum() < _MIN_TAGS:
        strangers = f", and {np.sum(~known)} of other ids" if (~known).any() else ""
        return no_corners(
            f"found {known.sum()} of the {len(tag_ids)} tags of '{target.name}'{strangers}; "
            f"at least {_MIN_TAGS} are needed (one alone does not show how it is turned)"
        )
    rows = np.array([place[int(i)] for i in ids[known]])
    index, pixels = tag_corners[rows], uv[known]
    points = target.points[index.ravel()]
    turned = [np.roll(pixels, turn, axis=1).reshape(-1, 2) for turn in range(4)]
    support = [int(homography_inliers(lens, points, t, iterations=60).sum()) for t in turned]
    if max(support) < 4 * _MIN_TAGS:
        return no_corners(
            f"{known.sum()} tags with ids of '{target.name}' do not lie as on the board: "
            "misread, or ids or places of the target's tags (first_id, id_order, columns, rows) "
            "are not those of the print"
        )
    return Corners(index.ravel(), turned[int(np.argmax(support))])


@lru_cache(maxsize=8)
def _april_detector(family: str, decimate: float, thread: int) -> Any:
    """A detector for one thread: two at a time in one of them crash the library."""
    from pyapriltags import Detector

    return Detector(families=family, nthreads=1, quad_decimate=decimate)


def _bare_tags(image: Image, family: str, target: Target) -> Tags:
    """Tags by the AprilTag library; at full resolution if half of it may be too coarse for some."""
    ids, uv = _detected(image, family, 2.0)
    if _too_coarse(ids, uv, target):
        ids, uv = _detected(image, family, 1.0)
    return ids, uv


def _too_coarse(ids: NDArray[np.int64], uv: Array, target: Target) -> bool:
    """Whether a tag is missing that is small in the image, judged by the scale of the others."""
    size_m = dict(zip(target.groups["tag_ids"].tolist(), _sizes_m(target).tolist(), strict=True))
    missing = [size for tag_id, size in size_m.items() if tag_id not in ids]
    own = [tag_id in size_m for tag_id in ids.tolist()]
    if not missing or sum(own) < _MIN_TAGS:
        return bool(missing)
    side_px = np.linalg.norm(uv - np.roll(uv, 1, axis=1), axis=2)[own].min(axis=1)
    px_per_m = side_px / [size_m[tag_id] for tag_id in ids[own].tolist()]
    return bool(px_per_m.min() * min(missing) < _COARSE_PX)


def _sizes_m(target: Target) -> Array:
    """(n,) outer edge of each tag of the target."""
    corners = target.points[target.groups["tag_corners"]]
    result: Array = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=-1)
    return result


def _detected(image: Image, family: str, decimate: float) -> Tags:
    found = {}
    detections = _april_detector(family, decimate, get_ident()).detect(image)
    for tag in sorted(detections, key=lambda tag: tag.decision_margin):
        if tag.hamming <= _MAX_HAMMING and tag.decision_margin >= _MIN_MARGIN:
            found[int(tag.tag_id)] = tag.corners
    # The library's pixel (0, 0) is the corner of the first pixel, OpenCV's its centre.
    corners = np.array([*found.values()]).reshape(-1, 4, 2) - 0.5
    return np.array([*found], dtype=np.int64), corners


@lru_cache(maxsize=8)
def _aruco_detector(family: str, border_cells: int, thread: int) -> Any:
    import cv2

    name = f"DICT_APRILTAG_{family.removeprefix('tag')}"
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = border_cells
    # Generous, for oblique and distant tags: the grid's geometry sorts out what is wrong.
    parameters.errorCorrectionRate = 0.9
    parameters.polygonalApproxAccuracyRate = 0.05
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    return cv2.aruco.ArucoDetector(dictionary, parameters)


def _aruco_tags(image: Image, family: str, border_cells: int) -> Tags:
    """Tags with wide borders by OpenCV; in the image enlarged twice if they seem to be small."""
    import cv2

    detector = _aruco_detector(family, border_cells, get_ident())
    corners, ids, _ = detector.detectMarkers(image)
    scale = 1
    if ids is None or len(ids) < _MIN_TAGS:
        scale = 2
        size = (image.shape[1] * scale, image.shape[0] * scale)
        enlarged = cv2.resize(image, size, interpolation=cv2.INTER_CUBIC)
        corners, ids, _ = detector.detectMarkers(enlarged)
    if ids is None:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 4, 2))
    found = (np.array(corners, dtype=np.float64).reshape(-1, 4, 2) + 0.5) / scale - 0.5
    # OpenCV goes clockwise.
    return np.asarray(ids, dtype=np.int64).ravel(), found[:, ::-1]


def _completed(image: Image, seed: Corners, target: Target, lens: Lens) -> Corners:
    """All corners of a board with corner squares, predicted from the tags that were decoded.

    Prediction goes through the pose and the lens model; each corner is then the saddle point
    between the tag and the square that touch in it, if the image shows one there.
    """
    corners, last = seed, seed.uv[:0]
    for _ in range(_COMPLETION_ROUNDS):
        fits = fit_poses(lens, target.points[corners.index], corners.uv)
        if not fits:
            return no_corners(f"{len(seed) // 4} tags found, but no pose explains their corners")
        corners = _saddles(image, fits[0], target, lens)
        if len(corners) < 4 * _MIN_TAGS:
            return no_corners(
                f"{len(seed) // 4} tags found, but only {len(corners)} of their corners touch a "
                "black square as `corner_squares: true` says"
            )
        if len(corners) == len(last) and np.abs(corners.uv - last).max() < _SETTLED_PX:
            break
        last = corners.uv
    return corners


def _saddles(image: Image, fit: PoseFit, target: Target, lens: Lens) -> Corners:
    config: Any = target.config
    index = target.groups["tag_corners"]
    p_t = target.points[index]
    outward = np.sign(p_t - p_t.mean(axis=1, keepdims=True))
    sideways = outward * np.array([1.0, -1.0, 0.0])
    cell = config.tag_size_m / (_code_cells(config.family) + 2 * config.border_cells)
    step = 0.5 * min(config.gap_m, config.border_cells * cell)
    around = p_t[..., None, :] + step * np.stack(
        [0 * outward, outward, -outward, sideways, -sideways], axis=-2
    )
    p_s = se3.apply(fit.T_s_t, around.reshape(-1, 3))
    uv, _, _ = lens.pixels_from_points(p_s)
    uv, inside = uv.reshape(-1, 5, 2), lens.sees(p_s).reshape(-1, 5).all(axis=1)
    predicted = uv[:, 0]
    # Pixels per metre in the direction in which the view foreshortens most.
    diagonals = np.stack([uv[:, 1] - uv[:, 2], uv[:, 3] - uv[:, 4]], axis=-1)
    scale = np.linalg.svd(diagonals, compute_uv=False)[:, -1] / (2 * np.sqrt(2) * step)
    window = scale * min(config.gap_m, 0.75 * config.border_cells * cell)
    refined = refine_saddles(image, predicted, window)
    moved = np.linalg.norm(refined - predicted, axis=1)
    grey = sample(image, uv[:, 1:] + (refined - predicted)[:, None])
    contrast = grey[:, 2:].min(axis=1) - grey[:, :2].max(axis=1)
    usual = np.median(contrast[inside]) if inside.any() else 0.0
    good = inside & (contrast > max(0.4 * usual, 10.0)) & (moved < np.maximum(scale * step, 2.0))
    return Corners(index.ravel()[good], refined[good])


def _code_cells(family: str) -> int:
    """Cells along a tag's code: tag36h11 has 6."""
    return int(np.sqrt(int(family.removeprefix("tag").split("h")[0])))
