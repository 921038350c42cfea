"""Target pages through the renderers that print shops use: poppler and ghostscript."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from rigcal import Registry, build_targets, load_rig
from rigcal.targets import Target

RIG = Path(__file__).parents[2] / "examples" / "husky.yaml"
PX_PER_MM = 3
DPI = f"{25.4 * PX_PER_MM:.2f}"


@pytest.fixture(scope="module")
def board() -> Target:
    registry = Registry.from_entry_points()
    return build_targets(load_rig(RIG, registry), registry)["board"]


@pytest.fixture(scope="module")
def write(command: Any) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        assert command("target", RIG, "--out", path, "--quiet").code == 0

    return write


def rendered(path: Path) -> Any:
    picture = path.with_suffix(".png")
    command = {
        ".pdf": ["pdftoppm", "-r", DPI, "-png", "-gray", "-singlefile",
                 str(path), str(picture.with_suffix(""))],
        ".ps": ["gs", "-q", "-dBATCH", "-dNOPAUSE", "-dSAFER", "-sDEVICE=pnggray", f"-r{DPI}",
                "-dGraphicsAlphaBits=4", "-dTextAlphaBits=4", f"-sOutputFile={picture}", str(path)],
    }[path.suffix]  # fmt: skip
    subprocess.run(command, check=True)
    return cv2.imread(str(picture), cv2.IMREAD_GRAYSCALE)


@pytest.mark.parametrize("suffix", [".pdf", ".ps"])
def test_tags_and_ruler_measure_what_the_rig_file_says(
    suffix: str, board: Target, tmp_path: Path, printed_page: Any, write: Callable[[Path], None]
) -> None:
    path = tmp_path / f"board{suffix}"
    write(path)
    page = printed_page(rendered(path), PX_PER_MM)
    found = page.tags_mm()
    ids = board.groups["tag_ids"].tolist()
    assert sorted(found) == ids
    measured = np.concatenate([found[tag_id] for tag_id in ids])
    expected = 1e3 * board.points[board.groups["tag_corners"].ravel(), :2]
    # Where the board lies on the page does not matter; how large and how turned it is does.
    offset = np.mean(measured - expected, axis=0)
    np.testing.assert_allclose(measured - offset, expected, atol=0.1)
    ticks = page.ruler_mm()
    assert len(ticks) == 101
    assert ticks[-1] - ticks[0] == pytest.approx(100, abs=0.1)


def test_pdftotext_finds_a_definition_that_builds_the_same_target(
    board: Target, tmp_path: Path, definition_in: Any, write: Callable[[Path], None]
) -> None:
    path = tmp_path / "board.pdf"
    write(path)
    text = subprocess.run(["pdftotext", str(path), "-"], check=True, capture_output=True, text=True)
    fields = definition_in(text.stdout, "board")
    assert type(board.config)(**fields) == board.config
