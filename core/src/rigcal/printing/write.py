"""The page as PDF, PostScript, SVG or PNG; the same target gives the same bytes."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rigcal.errors import InputError
from rigcal.files import replacing
from rigcal.printing.page import MM_PER_PT, Page, lay_out
from rigcal.printing.regions import Rings
from rigcal.targets.target import Target

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.path import Path as Outline

_STROKE_MM = 0.2
_FONTS = ("DejaVu Sans Mono", "monospace")
_MAX_PNG_PX = 300_000_000
_MAX_PNG_SIDE_PX = 2**16 - 1


def write_target_page(path: Path | str, target: Target, px_per_mm: int = 4) -> Page:
    """Write the printable page of a target, in the format of the path's suffix, and return it.

    The page (.pdf, .ps, .svg, .png) is as large as the board and its margins; it shows the board
    at true scale with cut marks at its corners, a 100 mm ruler, and the target's definition for
    rig.yaml. `px_per_mm` is the resolution of a PNG; the other formats hold exact polygons.

    InputError for another suffix, a PNG too large to be made, and a path that cannot be written.
    """
    path = Path(path)
    write = _FORMATS.get(path.suffix.lower())
    if write is None:
        raise InputError(
            f"{path}: found suffix '{path.suffix}', expected one of {', '.join(_FORMATS)}"
        )
    page = lay_out(target)
    if path.suffix.lower() == ".png":
        _check_png_size(path, page, px_per_mm)
    with _settings():
        content = write(_figure(page), page, target.name, px_per_mm)
    with replacing(path) as temporary:
        temporary.write_bytes(content)
    return page


@contextmanager
def _settings() -> Iterator[None]:
    """matplotlib as it comes, whatever the user's style is, with text that stays text."""
    from matplotlib import style

    own: dict[str, Any] = {
        "pdf.fonttype": 42,
        "ps.fonttype": 42,
        "svg.fonttype": "none",
        "svg.hashsalt": "rigcal",
    }
    with style.context(["default", own]):
        yield


def _figure(page: Page) -> Figure:
    from matplotlib.figure import Figure
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline
    from matplotlib.transforms import Affine2D

    figure = Figure(figsize=(page.size_mm[0] / 25.4, page.size_mm[1] / 25.4))
    mm = Affine2D().scale(1 / 25.4) + figure.dpi_scale_trans
    options: dict[str, Any] = {"transform": mm, "snap": False, "clip_on": False}
    for grey, rings in page.regions:
        figure.add_artist(
            PathPatch(_outline(rings), facecolor=str(grey), edgecolor="none", **options)
        )
    strokes = Outline.make_compound_path(*(Outline(line) for line in page.lines))
    width = _STROKE_MM / MM_PER_PT
    figure.add_artist(
        PathPatch(strokes, facecolor="none", linewidth=width, capstyle="butt", **options)
    )
    for text in page.texts:
        figure.text(
            text.x_mm, text.y_mm, text.text, transform=mm, family=_FONTS, size=text.size_pt,
            horizontalalignment=text.align, verticalalignment="baseline", parse_math=False,
        )  # fmt: skip
    return figure


def _outline(rings: Rings) -> Outline:
    from matplotlib.path import Path as Outline

    return Outline.make_compound_path(*(Outline(ring, closed=True) for ring in rings))


def _pdf(figure: Figure, page: Page, name: str, px_per_mm: int) -> bytes:
    return _saved(figure, format="pdf", metadata={"Title": name, "CreationDate": None})


def _ps(figure: Figure, page: Page, name: str, px_per_mm: int) -> bytes:
    """matplotlib writes the day, and leaves the page's size to the printer."""
    content = _saved(figure, format="ps", papertype="figure", metadata={"Creator": "rigcal"})
    width, height = np.array(page.size_mm) / MM_PER_PT
    setup = f"%%BeginSetup\n<< /PageSize [{width:.4f} {height:.4f}] >> setpagedevice\n%%EndSetup\n"
    content = re.sub(rb"%%CreationDate:.*\n", b"", content, count=1)
    return content.replace(b"%%EndProlog\n", b"%%EndProlog\n" + setup.encode(), 1)


def _svg(figure: Figure, page: Page, name: str, px_per_mm: int) -> bytes:
    return _saved(figure, format="svg", metadata={"Title": name, "Date": None})


def _png(figure: Figure, page: Page, name: str, px_per_mm: int) -> bytes:
    # A hair more than the page, as matplotlib cuts off what its product of inches and dpi lacks.
    width, height = (side / 25.4 * (1 + 1e-9) for side in page.size_mm)
    figure.set_size_inches(width, height)
    return _saved(figure, format="png", dpi=25.4 * px_per_mm, metadata={"Title": name})


_FORMATS: dict[str, Callable[[Figure, Page, str, int], bytes]] = {
    ".pdf": _pdf,
    ".ps": _ps,
    ".svg": _svg,
    ".png": _png,
}


def _saved(figure: Figure, **options: Any) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, **options)
    return buffer.getvalue()


def _check_png_size(path: Path, page: Page, px_per_mm: int) -> None:
    width, height = page.size_mm
    largest = int(min(_MAX_PNG_SIDE_PX / max(width, height), (_MAX_PNG_PX / width / height) ** 0.5))
    if px_per_mm > largest:
        raise InputError(
            f"{path}: the page of {width} x {height} mm has too many pixels at {px_per_mm} px/mm; "
            f"use {largest} px/mm or less, or PDF, which has no pixels"
        )
