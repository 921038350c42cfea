"""Pages as a renderer shows them, against the target they were made from."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import cv2
import numpy as np
import pypdfium2
import pytest
from matplotlib.path import Path as Outline

import rigcal
from rigcal.errors import InputError
from rigcal.printing import lay_out, write_target_page
from rigcal.targets import BUILTIN_TARGETS, Patch, Target, TargetConfig

TYPES = {kind.name: kind for kind in BUILTIN_TARGETS}
GRID = {"type": "apriltag_grid", "columns": 3, "rows": 2}
TAGS = [
    {"id": 40, "x_m": -0.07, "y_m": 0.03, "size_m": 0.1},
    {"id": 7, "x_m": 0.06, "y_m": 0.03, "size_m": 0.07, "turn_deg": 30},
    {"id": 586, "x_m": 0.05, "y_m": -0.06, "size_m": 0.04, "turn_deg": -90},
]
CONFIGS: dict[str, dict[str, Any]] = {
    "grid": GRID | {"tag_size_m": 0.06, "tag_gap_m": 0.023, "width_m": 0.3, "height_m": 0.2},
    "kalibr": GRID | {"tag_size_m": 0.055, "tag_spacing": 0.3, "border_cells": 2,
                      "corner_squares": True},
    "poster": {"type": "apriltag_poster", "width_m": 0.28, "height_m": 0.18, "tags": TAGS},
    "charuco": {"type": "charuco", "columns": 5, "rows": 4, "square_size_m": 0.041,
                "marker_size_m": 0.031, "inverted": True},
    "chess": {"type": "checkerboard", "columns": 7, "rows": 4, "square_size_m": 0.023,
              "offset_m": [0.01, -0.005], "width_m": 0.22, "height_m": 0.16},
}  # fmt: skip


def build(name: str) -> Target:
    kind = TYPES[CONFIGS[name]["type"]]
    return kind.build("board", kind.config(**CONFIGS[name]))


def render(path: Path, px_per_mm: float) -> Any:
    """(H, W) grey by PDFium, the renderer of Chrome."""
    with pypdfium2.PdfDocument(path) as document:
        # PDFium stretches the page to whole pixels, upwards: 2000.0001 must not become 2001.
        scale = px_per_mm * 25.4 / 72 * (1 - 1e-6)
        bitmap = document[0].render(scale=scale, grayscale=True)
        return np.array(bitmap.to_numpy()).reshape(bitmap.height, bitmap.width)


def text_of(path: Path) -> str:
    with pypdfium2.PdfDocument(path) as document:
        return str(document[0].get_textpage().get_text_range())


def points_mm(target: Target, page: Any) -> Any:
    return page.origin_mm + 1e3 * target.points[:, :2]


@pytest.mark.parametrize("name", ["grid", "poster"])
@pytest.mark.parametrize("suffix", [".pdf", ".png"])
def test_tags_come_back_to_a_tenth_of_a_millimetre(
    name: str, suffix: str, tmp_path: Path, printed_page: Any
) -> None:
    target, path = build(name), tmp_path / f"board{suffix}"
    page = write_target_page(path, target, px_per_mm=4)
    image = render(path, 4) if suffix == ".pdf" else cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    np.testing.assert_allclose(image.shape[::-1], np.multiply(page.size_mm, 4), atol=1)
    printed = printed_page(image, 4)
    found = printed.tags_mm()
    ids, corners = target.groups["tag_ids"].tolist(), target.groups["tag_corners"]
    assert sorted(found) == sorted(ids)
    for tag_id, index in zip(ids, corners, strict=True):
        np.testing.assert_allclose(found[tag_id], points_mm(target, page)[index], atol=0.1)
    ticks = printed.ruler_mm()
    assert len(ticks) == 101
    assert ticks[-1] - ticks[0] == pytest.approx(100, abs=0.1)
    np.testing.assert_allclose(np.diff(ticks), 1, atol=0.1)


def test_charuco_corners_come_back_to_a_tenth_of_a_millimetre(
    tmp_path: Path, printed_page: Any
) -> None:
    target, path = build("charuco"), tmp_path / "board.pdf"
    page = write_target_page(path, target)
    printed = printed_page(255 - render(path, 8), 8)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_1000)
    board = cv2.aruco.CharucoBoard((5, 4), 0.041, 0.031, dictionary)
    corners, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(printed.image)
    assert sorted(ids.ravel()) == list(range(12))
    found = printed.mm(corners.reshape(-1, 2))
    np.testing.assert_allclose(found, points_mm(target, page)[ids.ravel()], atol=0.1)


def paint(image: Any, polygon_mm: Any, px_per_mm: float, value: int) -> None:
    """Set the pixels whose centres lie in a polygon."""
    corners = polygon_mm * [px_per_mm, -px_per_mm] + [0, image.shape[0]] - 0.5
    low, high = np.floor(corners.min(axis=0)).astype(int), np.ceil(corners.max(axis=0)).astype(int)
    v, u = np.mgrid[low[1] : high[1] + 1, low[0] : high[0] + 1]
    inside = Outline(corners).contains_points(np.column_stack([u.ravel(), v.ravel()]))
    image[low[1] : high[1] + 1, low[0] : high[0] + 1][inside.reshape(u.shape)] = value


@pytest.mark.parametrize("px_per_mm", [0.7, 1.9, 3.3])
@pytest.mark.parametrize("name", CONFIGS)
def test_every_pixel_of_the_board_is_as_the_patches_say(
    name: str, px_per_mm: float, tmp_path: Path
) -> None:
    """No seam between cells at any zoom, nothing else on the board, white around it."""
    target, path = build(name), tmp_path / "board.pdf"
    page = write_target_page(path, target)
    image = render(path, px_per_mm)
    expected = np.full(image.shape, 255, dtype=np.uint8)
    for patch in target.patches:
        paint(expected, page.origin_mm + 1e3 * patch.polygon, px_per_mm, round(255 * patch.grey))
    board = np.zeros(image.shape, dtype=np.uint8)
    paint(board, page.origin_mm + 1e3 * target.outline, px_per_mm, 1)
    board = board.astype(bool)
    around = np.ones((5, 5), dtype=np.uint8)
    plain = cv2.dilate(expected, around) == cv2.erode(expected, around)
    assert np.mean(plain[board]) > 0.15
    assert np.array_equal(image[board & plain], expected[board & plain])


@pytest.mark.parametrize("name", CONFIGS)
def test_the_definition_on_the_page_builds_the_same_target(
    name: str, tmp_path: Path, definition_in: Any
) -> None:
    target, path = build(name), tmp_path / "board.pdf"
    write_target_page(path, target)
    fields = definition_in(text_of(path), "board")
    assert TYPES[fields["type"]].config(**fields) == target.config


def test_the_same_target_gives_the_same_bytes_in_another_process(tmp_path: Path) -> None:
    """Also under a user's own style, which must not change the page."""
    program = """
import json, sys, matplotlib
from rigcal.printing import write_target_page
from rigcal.targets import BUILTIN_TARGETS
matplotlib.rcParams.update({"savefig.bbox": "tight", "font.family": "serif", "lines.linewidth": 9})
fields = json.loads(sys.argv[1])
kind = {kind.name: kind for kind in BUILTIN_TARGETS}[fields["type"]]
for path in sys.argv[2:]:
    write_target_page(path, kind.build("board", kind.config(**fields)))
"""
    here = [tmp_path / f"here{suffix}" for suffix in (".pdf", ".ps", ".svg", ".png")]
    there = [path.with_stem("there") for path in here]
    for path in here:
        write_target_page(path, build("chess"))
    environment = os.environ | {"PYTHONHASHSEED": "77", "SOURCE_DATE_EPOCH": "1"}
    arguments = [json.dumps(CONFIGS["chess"]), *map(str, there)]
    subprocess.run([sys.executable, "-c", program, *arguments], check=True, env=environment)
    for one, other in zip(here, there, strict=True):
        assert one.read_bytes() == other.read_bytes()


def test_svg_has_the_size_and_the_corners_of_the_board_in_print_units(tmp_path: Path) -> None:
    target, path = build("chess"), tmp_path / "board.svg"
    page = write_target_page(path, target)
    svg = ElementTree.parse(path).getroot()
    size_pt = np.array([float(svg.attrib[key].removesuffix("pt")) for key in ("width", "height")])
    np.testing.assert_allclose(size_pt * 25.4 / 72, page.size_mm, atol=1e-3)
    box = [float(number) for number in svg.attrib["viewBox"].split()]
    np.testing.assert_allclose(box, [0, 0, *size_pt])
    paths = [node.attrib["d"] for node in svg.iter() if node.tag.endswith("}path")]
    numbers = [np.array(re.findall(r"-?[\d.]+", d), dtype=float) for d in paths if " C" not in d]
    vertices = np.concatenate([n.reshape(-1, 2) for n in numbers]) * [1, -1] + [0, size_pt[1]]
    for corner in points_mm(target, page):
        assert np.linalg.norm(vertices * 25.4 / 72 - corner, axis=1).min() < 1e-3
    words = " ".join("".join(node.itertext()) for node in svg.iter() if node.tag.endswith("}text"))
    assert "square_size_m: 0.023" in words


def test_postscript_asks_for_paper_of_the_page_and_names_no_day(tmp_path: Path) -> None:
    """Rendered in tests/system."""
    path = tmp_path / "board.ps"
    page = write_target_page(path, build("chess"))
    text = path.read_text()
    found = re.findall(r"/PageSize \[([\d.]+) ([\d.]+)\] >> setpagedevice", text)
    np.testing.assert_allclose(np.array(found, dtype=float)[0] * 25.4 / 72, page.size_mm, atol=1e-3)
    assert text.index("setpagedevice") < text.index("%%Page: 1 1")
    assert "CreationDate" not in text


@pytest.mark.parametrize("px_per_mm", [4, 7])
def test_png_says_its_resolution(px_per_mm: int, tmp_path: Path) -> None:
    from PIL import Image

    path = tmp_path / "board.png"
    page = write_target_page(path, build("chess"), px_per_mm=px_per_mm)
    with Image.open(path) as image:
        assert image.size == tuple(px_per_mm * side for side in page.size_mm)
        assert image.info["dpi"] == pytest.approx((25.4 * px_per_mm,) * 2)


@pytest.mark.parametrize(
    "size_m", [(0.04, 0.03), (0.2, 0.15), (2.0, 1.6), (0.1, 2.0)], ids=lambda s: f"{s[0]} m"
)
def test_text_is_legible_and_stays_on_the_page(size_m: tuple[float, float], tmp_path: Path) -> None:
    """Ink within the page, apart from the board and from each other line."""
    kind = TYPES["checkerboard"]
    config = kind.config(
        type="checkerboard", columns=2, rows=2, square_size_m=0.01,
        width_m=size_m[0], height_m=size_m[1],
    )  # fmt: skip
    target, path = kind.build("a-board-with-a-rather-long-name.2026", config), tmp_path / "b.pdf"
    page = write_target_page(path, target)
    board_bottom = page.origin_mm[1] - 500 * size_m[1]
    with pypdfium2.PdfDocument(path) as document:
        text = document[0].get_textpage()
        boxes = np.array([text.get_rect(i) for i in range(text.count_rects())]) * 25.4 / 72
    assert boxes[:, :2].min() > 5
    assert boxes[:, 2].max() < page.size_mm[0] - 5
    assert boxes[:, 3].max() < board_bottom - 11
    overlap = (boxes[:, None, :2] < boxes[None, :, 2:]) & (boxes[None, :, :2] < boxes[:, None, 2:])
    assert not np.any(np.triu(overlap.all(axis=-1), k=1))
    assert all(8 <= line.size_pt <= 20 for line in page.texts)


def test_cut_marks_point_at_the_corners_and_stay_off_the_board() -> None:
    target = build("grid")
    page = lay_out(target)
    corners = page.origin_mm + 1e3 * target.outline
    marks = page.lines[:8]
    along = marks[:, 1] - marks[:, 0]
    for corner in corners:
        to_corner = corner - marks[:, 0]
        off = np.abs(along[:, 0] * to_corner[:, 1] - along[:, 1] * to_corner[:, 0])
        near = np.linalg.norm(to_corner, axis=1) < 4
        assert np.sum(near & (off < 1e-6)) == 2
    inside = (marks > corners.min(axis=0) - 2) & (marks < corners.max(axis=0) + 2)
    assert not inside.all(axis=-1).any()


def test_a_target_of_a_plugin_needs_patches_only(tmp_path: Path) -> None:
    triangle = np.array([[-0.05, -0.04], [0.05, -0.04], [0.0, 0.05]])
    outline = np.array([[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]])
    config = TargetConfig(type="triangle")
    target = Target("board", config, outline, np.zeros((1, 3)), patches=(Patch(triangle, 0.5),))
    path = tmp_path / "board.pdf"
    page = rigcal.write_target_page(path, target)
    image = render(path, 2)
    u, v = np.rint(page.origin_mm * 2).astype(int)
    assert image[image.shape[0] - v, u] == pytest.approx(128, abs=1)


@pytest.mark.parametrize("name", ["board", "board.jpg", "board.pdf.gz"])
def test_an_unknown_suffix_is_refused_with_those_that_are_known(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"expected one of \.pdf, \.ps, \.svg, \.png"):
        write_target_page(tmp_path / name, build("chess"))
    assert list(tmp_path.iterdir()) == []


def test_a_png_beyond_all_bounds_is_refused_with_a_resolution_that_works(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"310 x 252 mm has too many pixels at 90 px/mm; use 61 px/mm"
    ):
        write_target_page(tmp_path / "board.png", build("poster"), px_per_mm=90)
