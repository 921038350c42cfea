"""Colours and axes that all pictures share."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INK, QUIET, GRID, BOARD = "#222222", "#8a949e", "#e6e9ec", "#d6336c"
COLOURS = (
    "#2464b4", "#e8810c", "#27913c", "#8e44ad", "#0d98a8",
    "#b8860b", "#c0392b", "#6b7785", "#7cb518", "#5f3dc4",
)  # fmt: skip
"""Of the sensors, in the order of the rig."""


def metric_axes(axes: Axes, across: str, up: str) -> None:
    """Equal scales in metres, a quiet grid behind."""
    axes.set_aspect("equal")
    axes.set_xlabel(across, fontsize=8, color=INK, labelpad=2)
    axes.set_ylabel(up, fontsize=8, color=INK, labelpad=2)
    axes.tick_params(labelsize=7, colors=INK, length=2)
    axes.locator_params(nbins=7)
    axes.grid(color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def frame_box(axes: Axes, low: tuple[float, float], high: tuple[float, float]) -> None:
    """Show at least the box from `low` to `high`, as wide and high as the axes allow."""
    box = axes.get_position()
    width_px, height_px = axes.figure.bbox.size
    shape = (box.width * width_px) / (box.height * height_px)
    width, height = high[0] - low[0], high[1] - low[1]
    width, height = max(width, height * shape), max(height, width / shape)
    middle = ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2)
    axes.set_xlim(middle[0] - width / 2, middle[0] + width / 2)
    axes.set_ylim(middle[1] - height / 2, middle[1] + height / 2)
