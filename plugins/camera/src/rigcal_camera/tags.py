"""Corners of AprilTag grids: bare tags by the AprilTag library, Kalibr's boards by completion."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.targets.target import Target
from rigcal_camera.corners import Corners, no_corners, refine_saddles, sample
from rigcal_camera.frames import Image
from rigcal_camera.lens import Lens
from rigcal_camera.pose import PoseFit, fit_poses, homography_inliers

_MIN_TAGS = 2
_MIN_MARGIN = 10.0
_MAX_HAMMING = 1
_COMPLETION_ROUNDS = 2

Tags = tuple[NDArray[np.int64], Array]
"""Ids (n,) and corners (n, 4, 2), anticlockwise as seen, from an unknown first corner."""


def find_tag_corners(image: Image, target: Target, lens: Lens) -> Corners:
    """Corners of every tag of the target found in the image."""
    config: Any = target.config
    border_cells = getattr(config, "border_cells", 1)
    saddles = getattr(config, "corner_squares", False)
    if border_cells == 1 and not saddles:
        tags = _bare_tags(image, target)
    else:
        tags = _aruco_tags(image, config.family, border_cells, refine=not saddles)
    corners = _labelled(*tags, target, lens)
    if saddles and len(corners):
        return _completed(image, corners, target, lens)
    return corners


def _labelled(ids: NDArray[np.int64], uv: Array, target: Target, lens: Lens) -> Corners:
    """Corners of the target's own tags, with the first corner found from the grid's geometry.

    Libraries print a tag's code turned by multiples of 90 degrees against each other: of the four
    turns, the one with which the tags together form the grid is right.
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
    support = [int(homography_inliers(lens, points, t).sum()) for t in turned]
    if max(support) < 4 * _MIN_TAGS:
        return no_corners(
            f"{known.sum()} tags with ids of '{target.name}' do not lie as on the board: check "
            "columns, rows, first_id and id_order of the target"
        )
    return Corners(index.ravel(), turned[int(np.argmax(support))])


@lru_cache(maxsize=8)
def _april_detector(family: str, decimate: float) -> Any:
    from pyapriltags import Detector

    return Detector(families=family, nthreads=1, quad_decimate=decimate)


def _bare_tags(image: Image, target: Target) -> Tags:
    """Tags by the AprilTag library; at full resolution if half of it shows too few."""
    family = getattr(target.config, "family", "tag36h11")
    wanted = set(target.groups["tag_ids"].tolist())
    for decimate in (2.0, 1.0):
        found = {}
        detections = _april_detector(family, decimate).detect(image)
        for tag in sorted(detections, key=lambda tag: tag.decision_margin):
            if tag.hamming <= _MAX_HAMMING and tag.decision_margin >= _MIN_MARGIN:
                found[int(tag.tag_id)] = tag.corners
        if len(wanted & set(found)) >= _MIN_TAGS:
            break
    # The library's pixel (0, 0) is the corner of the first pixel, OpenCV's its centre.
    corners = np.array([*found.values()]).reshape(-1, 4, 2) - 0.5
    return np.array([*found], dtype=np.int64), corners


@lru_cache(maxsize=8)
def _aruco_detector(family: str, border_cells: int, refine: bool) -> Any:
    import cv2

    name = f"DICT_APRILTAG_{family.removeprefix('tag')}"
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = border_cells
    parameters.adaptiveThreshWinSizeMax = 33
    if refine:
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    return cv2.aruco.ArucoDetector(dictionary, parameters)


def _aruco_tags(image: Image, family: str, border_cells: int, refine: bool) -> Tags:
    corners, ids, _ = _aruco_detector(family, border_cells, refine).detectMarkers(image)
    if ids is None:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 4, 2))
    found = np.array(corners, dtype=np.float64).reshape(-1, 4, 2)
    # OpenCV goes clockwise.
    return np.asarray(ids, dtype=np.int64).ravel(), found[:, ::-1]


def _completed(image: Image, seed: Corners, target: Target, lens: Lens) -> Corners:
    """All corners of a board with corner squares, predicted from the tags that were decoded.

    Prediction goes through the pose and the lens model; each corner is then the saddle point
    between the tag and the square that touch in it, if the image shows one there.
    """
    corners = seed
    for _ in range(_COMPLETION_ROUNDS):
        fits = fit_poses(lens, target.points[corners.index], corners.uv)
        if not fits:
            return no_corners(f"{len(seed) // 4} tags found, but no pose explains their corners")
        completed = _saddles(image, fits[0], target, lens)
        if len(completed) < 4 * _MIN_TAGS:
            return no_corners(
                f"{len(seed) // 4} tags found, but only {len(completed)} of their corners touch a "
                "black square as `corner_squares: true` says"
            )
        corners = completed
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
    reach = np.linalg.norm(uv[:, 1:] - predicted[:, None], axis=2).min(axis=1) / np.sqrt(2)
    window = 0.8 * reach * min(config.gap_m, 1.5 * cell) / step
    refined = refine_saddles(image, predicted, window)
    moved = np.linalg.norm(refined - predicted, axis=1)
    grey = sample(image, uv[:, 1:] + (refined - predicted)[:, None])
    contrast = grey[:, 2:].min(axis=1) - grey[:, :2].max(axis=1)
    usual = np.median(contrast[inside]) if inside.any() else 0.0
    good = inside & (contrast > max(0.4 * usual, 10.0)) & (moved < np.maximum(reach, 2.0))
    return Corners(index.ravel()[good], refined[good])


def _code_cells(family: str) -> int:
    """Cells along a tag's code: tag36h11 has 6."""
    return int(np.sqrt(int(family.removeprefix("tag").split("h")[0])))
