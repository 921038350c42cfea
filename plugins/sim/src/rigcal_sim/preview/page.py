"""One page per exposure: what every sensor saw of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rigcal.files import replacing
from rigcal.plugin import FrameView
from rigcal_sim.preview.panels import Sensor, draw_panel
from rigcal_sim.preview.style import INK

_PANEL_IN = (4.9, 4.2)
_HEAD_IN, _GAP_IN = 0.55, 0.45
_DPI = 110


def write_page(
    path: Path, title: str, seen: Sequence[tuple[Sensor, FrameView | str]], columns: int
) -> None:
    """A PNG with a panel for each sensor: images, then scans, then clouds."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = -(-len(seen) // columns)
    width, height = columns * _PANEL_IN[0], rows * _PANEL_IN[1] + _HEAD_IN
    figure = Figure((width, height), dpi=_DPI, facecolor="white")
    FigureCanvasAgg(figure)
    figure.text(0.012, 1 - 0.3 / height, title, fontsize=13, color=INK, va="center")
    for number, (sensor, view) in enumerate(sorted(seen, key=_rank)):
        row, column = divmod(number, columns)
        left = column * _PANEL_IN[0] + _GAP_IN
        bottom = (rows - 1 - row) * _PANEL_IN[1] + _GAP_IN
        size = (_PANEL_IN[0] - _GAP_IN - 0.12, _PANEL_IN[1] - _GAP_IN - 0.3)
        box = (left / width, bottom / height, size[0] / width, size[1] / height)
        draw_panel(figure.add_axes(box), sensor, view)
    with replacing(path) as temporary:
        figure.savefig(
            temporary, format="png", metadata={"Software": None}, pil_kwargs={"compress_level": 2}
        )


def _rank(item: tuple[Sensor, FrameView | str]) -> int:
    sensor, view = item
    if isinstance(view, FrameView) and view.image is not None:
        return 0
    return 1 if sensor.kind.flat else 2
