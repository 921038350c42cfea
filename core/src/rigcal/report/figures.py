"""The report's figures as SVG text: the same calibration gives the same bytes."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SETTINGS = Lock()
"""Matplotlib's settings belong to the whole process."""
_VIEWS = (("x", "y"), ("x", "z"), ("y", "z"))
_AXIS_COLOURS = ("#c0392b", "#27ae60", "#2464b4")
_INK, _GRID = "#222222", "#e6e9ec"


def rig_figure(sensors: Mapping[str, Array]) -> str:
    """SVG of the sensors alone, named, with their axes (x red, y green, z blue)."""
    figure, panels = _panels("{} [mm]")
    scaled = {name: _in_millimetres(T) for name, T in sensors.items()}
    origins = np.array([T[:3, 3] for T in scaled.values()])
    length = 0.15 * _extent(origins)
    points = np.vstack([se3.apply(T, length * np.eye(3)) for T in scaled.values()] + [origins])
    for axes, (i, j) in panels:
        for name, T in scaled.items():
            _draw_frame(axes, T, i, j, length)
            at = (T[i, 3], T[j, 3])
            axes.annotate(name, at, (3, 3), textcoords="offset points", fontsize=7, color=_INK)
        _frame_view(axes, points, i, j)
    return _svg(figure)


def _panels(label: str) -> tuple[Figure, list[tuple[Axes, tuple[int, int]]]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 3.8), layout="constrained")
    panels = []
    for number, (a, b) in enumerate(_VIEWS, start=1):
        axes = figure.add_subplot(1, 3, number)
        axes.set_aspect("equal")
        axes.set_xlabel(label.format(a), fontsize=8)
        axes.set_ylabel(label.format(b), fontsize=8)
        axes.tick_params(labelsize=7, colors=_INK)
        axes.grid(color=_GRID, linewidth=0.6)
        axes.set_axisbelow(True)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
        panels.append((axes, ("xyz".index(a), "xyz".index(b))))
    return figure, panels


def _draw_frame(axes: Axes, T: Array, i: int, j: int, length: float) -> None:
    """A sensor as a dot with its three axes, projected to coordinates i and j."""
    tips = se3.apply(T, length * np.eye(3))
    for tip, colour in zip(tips, _AXIS_COLOURS, strict=True):
        axes.plot([T[i, 3], tip[i]], [T[j, 3], tip[j]], color=colour, linewidth=1.2)
    axes.plot(T[i, 3], T[j, 3], "o", color=_INK, markersize=2.5)


def _frame_view(axes: Axes, points: Array, i: int, j: int) -> None:
    """Show all points (N, 3), at the same scale in every view."""
    half = 0.58 * _extent(points)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    axes.set_xlim(middle[i] - half, middle[i] + half)
    axes.set_ylim(middle[j] - half, middle[j] + half)


def _extent(points: Array) -> float:
    """Largest side of the points' box; 1 where they coincide."""
    return float(np.ptp(points, axis=0).max()) or 1.0


def _in_millimetres(T: Array) -> Array:
    return se3.transform(T[:3, :3], 1e3 * T[:3, 3])


def _svg(figure: Figure) -> str:
    """The figure as an <svg> element: text as text, no date, ids that do not change."""
    import matplotlib

    buffer = io.StringIO()
    with SETTINGS, matplotlib.rc_context({"svg.hashsalt": "rigcal", "svg.fonttype": "none"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    return re.sub(r"<metadata>.*?</metadata>\s*", "", text[text.index("<svg") :], flags=re.DOTALL)
