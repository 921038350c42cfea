from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pyapriltags
import pytest
from numpy.typing import NDArray
from pydantic import ValidationError

from rigcal.targets import BUILTIN_TARGETS, Target

TYPES = {kind.name: kind for kind in BUILTIN_TARGETS}
GRID: dict[str, Any] = {"columns": 6, "rows": 4, "tag_size_m": 0.15, "tag_gap_m": 0.04}
BOARD = {"width_m": 1.2, "height_m": 0.9}
TAGS: list[dict[str, Any]] = [
    {"id": 40, "x_m": -0.2, "y_m": 0.1, "size_m": 0.3},
    {"id": 7, "x_m": 0.2, "y_m": 0.1, "size_m": 0.2, "turn_deg": 30},
    {"id": 586, "x_m": 0.15, "y_m": -0.15, "size_m": 0.1, "turn_deg": -90},
]
TOUCHING = {"id": 1, "x_m": -0.2, "y_m": -0.1, "size_m": 0.1}
POSTER: dict[str, Any] = {"width_m": 0.8, "height_m": 0.6, "tags": TAGS}


def build(kind: str, **fields: Any) -> Target:
    target_type = TYPES[kind]
    return target_type.build("board", target_type.config(type=kind, **fields))


def render(
    target: Target, px_per_m: float = 1000, margin_px: int = 20
) -> tuple[NDArray[np.uint8], Any]:
    """The print from the front, and the function from target points to pixels."""
    width, height = (round(float(x) * px_per_m) + 2 * margin_px for x in target.size)
    image = np.full((height, width), 255, dtype=np.uint8)

    def pixels(points: NDArray[np.float64]) -> NDArray[np.float64]:
        xy = (points[..., :2] - target.outline.min(axis=0)) * px_per_m + margin_px
        return np.stack([xy[..., 0], height - xy[..., 1]], axis=-1) - 0.5

    for patch in target.patches:
        low, high = pixels(patch.polygon).min(axis=0), pixels(patch.polygon).max(axis=0)
        (u0, v0), (u1, v1) = np.rint(low + 0.5).astype(int), np.rint(high + 0.5).astype(int)
        image[slice(v0, v1), slice(u0, u1)] = round(255 * patch.grey)
    return image, pixels


@pytest.mark.parametrize("family", ["tag16h5", "tag25h9", "tag36h11"])
def test_apriltag_grid_is_printed_upright_with_its_ids(family: str) -> None:
    target = build("apriltag_grid", **GRID, **BOARD, family=family)
    image, pixels = render(target)
    found = pyapriltags.Detector(families=family).detect(image)
    assert sorted(d.tag_id for d in found) == list(range(24)) == target.groups["tag_ids"].tolist()
    for detection in found:
        expected = pixels(target.points[target.groups["tag_corners"][detection.tag_id]])
        # The library's corners wrap anticlockwise from the bottom left of the upright tag.
        np.testing.assert_allclose(detection.corners - 0.5, expected, atol=0.7)


def test_apriltag_grid_ids_start_bottom_left_or_top_left() -> None:
    below = build("apriltag_grid", **GRID)
    above = build("apriltag_grid", **GRID, id_order="top_left", first_id=3)
    first, second = below.points[below.groups["tag_corners"][[0, 1]]].mean(axis=1)
    assert np.all(first[:2] < 0)
    np.testing.assert_allclose(second - first, [0.19, 0, 0], atol=1e-12)
    assert above.groups["tag_ids"][0] == 3
    np.testing.assert_allclose(above.points[:4].mean(axis=0)[:2], first[:2] * [1, -1], atol=1e-12)


@pytest.mark.parametrize("id_order", ["bottom_left", "top_left"])
def test_kalibr_print_is_read_by_opencv_with_two_border_cells(id_order: str) -> None:
    fields = GRID | {"tag_gap_m": None, "tag_spacing": 0.3, "id_order": id_order}
    target = build("apriltag_grid", **fields, border_cells=2, corner_squares=True)
    image, pixels = render(target)
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = 2
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36H11)
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(image)
    assert len(ids) >= 20
    for quad, tag_id in zip(corners, ids.ravel(), strict=True):
        expected = pixels(target.points[target.groups["tag_corners"][int(tag_id)]])
        # OpenCV goes clockwise from the top left of its own print, which is upside down to ours.
        np.testing.assert_allclose(quad[0], expected[[1, 0, 3, 2]], atol=1.5)


def test_corner_squares_lie_between_the_tags() -> None:
    target = build("apriltag_grid", **GRID, corner_squares=True)
    np.testing.assert_allclose(target.size, [6 * 0.19 + 0.04, 4 * 0.19 + 0.04])
    image, pixels = render(target)
    centre_of_four = target.points[:4, :2].max(axis=0) + 0.02
    u, v = (round(float(x)) for x in pixels(centre_of_four))
    assert image[v, u] == 0
    assert image[v, u + 60] == 255


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize(("columns", "rows"), [(5, 4), (4, 5), (5, 7)])
def test_charuco_looks_as_opencv_draws_it(columns: int, rows: int, legacy: bool) -> None:
    fields = {"columns": columns, "rows": rows, "square_size_m": 0.06, "marker_size_m": 0.042}
    target = build("charuco", **fields, dictionary="DICT_5X5_100", legacy_pattern=legacy)
    image, _ = render(target, margin_px=0)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    board = cv2.aruco.CharucoBoard((columns, rows), 0.06, 0.042, dictionary)
    board.setLegacyPattern(legacy)
    drawn = board.generateImage((columns * 60, rows * 60))
    assert np.mean(image != drawn) < 0.002


@pytest.mark.parametrize("inverted", [False, True])
def test_charuco_point_is_opencvs_corner(inverted: bool) -> None:
    fields = {"columns": 4, "rows": 5, "square_size_m": 0.054, "marker_size_m": 0.0405}
    target = build("charuco", **fields, inverted=inverted, width_m=0.3, height_m=0.4)
    image, pixels = render(target, px_per_m=2000)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_1000)
    board = cv2.aruco.CharucoBoard((4, 5), 0.054, 0.0405, dictionary)
    seen = 255 - image if inverted else image
    corners, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(seen)
    assert sorted(ids.ravel()) == list(range(12)) == target.groups["grid"].ravel().tolist()
    expected = pixels(target.points[ids.ravel()])
    np.testing.assert_allclose(corners.reshape(-1, 2), expected, atol=0.6)


@pytest.mark.parametrize(
    ("columns", "rows", "turns"), [(7, 5, 1), (6, 4, 1), (9, 6, 0), (5, 5, 1), (4, 4, 3)]
)
def test_checkerboard_symmetries_are_those_of_the_image(
    columns: int, rows: int, turns: int
) -> None:
    target = build("checkerboard", columns=columns, rows=rows, square_size_m=0.05)
    image, _ = render(target, margin_px=0)
    same = [k for k in (1, 2, 3) if np.array_equal(image, np.rot90(image, k))]
    assert len(same) == len(target.symmetries) == turns
    for permutation in target.symmetries:
        moved = target.points[permutation]
        R = np.linalg.lstsq(target.points[:, :2], moved[:, :2], rcond=None)[0]
        np.testing.assert_allclose(target.points[:, :2] @ R, moved[:, :2], atol=1e-12)
        np.testing.assert_allclose(R.T @ R, np.eye(2), atol=1e-12)


def test_checkerboard_corners_go_row_by_row_from_the_top_left() -> None:
    target = build(
        "checkerboard",
        columns=9,
        rows=6,
        square_size_m=0.025,
        offset_m=(0.01, -0.02),
        width_m=0.3,
        height_m=0.25,
    )
    corner = target.points[target.groups["grid"]]
    np.testing.assert_allclose(corner[0, 0, :2], [0.01 - 0.1, -0.02 + 0.0625])
    np.testing.assert_allclose(corner[0, 1] - corner[0, 0], [0.025, 0, 0], atol=1e-12)
    np.testing.assert_allclose(corner[1, 0] - corner[0, 0], [0, -0.025, 0], atol=1e-12)
    image, pixels = render(target)
    u, v = (round(float(x)) for x in pixels(corner[0, 0]))
    assert image[v - 5, u - 5] == 0
    assert image[v - 5, u + 5] == 255


def test_poster_puts_every_tag_where_its_line_says() -> None:
    target = build("apriltag_poster", **POSTER, offset_m=(0.01, -0.02))
    assert target.groups["tag_ids"].tolist() == [40, 7, 586]
    np.testing.assert_allclose(target.size, [0.8, 0.6])
    corner = target.points[target.groups["tag_corners"]][..., :2]
    centres = [[-0.19, 0.08], [0.21, 0.08], [0.16, -0.17]]
    np.testing.assert_allclose(corner.mean(axis=1), centres, atol=1e-12)
    sides = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=-1)
    np.testing.assert_allclose(sides, np.repeat([[0.3], [0.2], [0.1]], 4, axis=1))
    # The upright tag starts bottom left; a quarter turn clockwise takes that to the top left.
    np.testing.assert_allclose(corner[0, 0], [-0.19 - 0.15, 0.08 - 0.15])
    np.testing.assert_allclose(corner[2, 0], [0.16 - 0.05, -0.17 + 0.05], atol=1e-12)
    direction = corner[1, 1] - corner[1, 0]
    np.testing.assert_allclose(np.degrees(np.arctan2(direction[1], direction[0])), 30)


def test_poster_is_printed_as_the_april_tag_library_reads_it() -> None:
    tags = [tag | {"turn_deg": turn} for tag, turn in zip(TAGS, (0, 180, -90), strict=True)]
    target = build("apriltag_poster", **POSTER | {"tags": tags})
    image, pixels = render(target)
    found = {d.tag_id: d for d in pyapriltags.Detector(families="tag36h11").detect(image)}
    assert set(found) == {40, 7, 586}
    for tag_id, index in zip(
        target.groups["tag_ids"].tolist(), target.groups["tag_corners"], strict=True
    ):
        expected = pixels(target.points[index])
        np.testing.assert_allclose(found[tag_id].corners - 0.5, expected, atol=0.7)


CHARUCO: dict[str, Any] = {"columns": 5, "rows": 4, "square_size_m": 0.05, "marker_size_m": 0.03}


@pytest.mark.parametrize(
    ("kind", "fields", "message"),
    [
        ("apriltag_grid", GRID | {"tag_spacing": 0.3}, "found both of tag_gap_m and tag_spacing"),
        ("apriltag_grid", GRID | {"tag_gap_m": None}, "found neither of tag_gap_m and tag_spacing"),
        ("apriltag_grid", GRID | {"family": "tag16h5", "first_id": 10},
         "end with id 33, but tag16h5 has ids 0 to 29"),
        ("apriltag_grid", GRID | {"width_m": 1.0}, "it is 1.1 m and width_m is 1 m; enlarge"),
        ("apriltag_grid", GRID | BOARD | {"offset_m": (0.0, 0.1)}, "needs height_m >= 0.92"),
        ("apriltag_poster", POSTER | {"tags": [*TAGS, TAGS[1]]},
         "several tags have the id 7; every tag needs its own id"),
        ("apriltag_poster", POSTER | {"family": "tag25h9"}, "id 586 found, but tag25h9 has ids"),
        ("apriltag_poster", POSTER | {"height_m": 0.46},
         "tag 40 at (-0.2, 0.1) m reaches over the sheet's edge by 0.02 m; the sheet ends 0.4 m"),
        ("apriltag_poster", POSTER | {"tags": [*TAGS, TAGS[1] | {"id": 8, "x_m": 0.1}]},
         "tag 7 at (0.2, 0.1) m and tag 8 at (0.1, 0.1) m overlap or touch; leave white"),
        ("apriltag_poster", POSTER | {"tags": [*TAGS, TOUCHING]},
         "overlap or touch"),
        ("apriltag_poster", POSTER | {"tags": TAGS[:1]}, "found 1, expected two or more tags"),
        ("checkerboard", {"columns": 7, "rows": 5, "square_size_m": 0.1, "height_m": 0.5},
         "it is 0.6 m and height_m is 0.5 m"),
        ("charuco", CHARUCO | {"marker_size_m": 0.06}, "markers must be smaller than squares"),
        ("charuco", CHARUCO | {"dictionary": "DICT_4X4"}, "known are DICT_4X4_50, "),
        ("charuco", CHARUCO | {"columns": 20, "rows": 10, "dictionary": "DICT_4X4_50"},
         "hold 100 markers, but DICT_4X4_50 has 50"),
    ],
)  # fmt: skip
def test_a_wrong_config_says_what_to_do(kind: str, fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError) as caught:
        TYPES[kind].config(type=kind, **fields)
    assert message in str(caught.value)
