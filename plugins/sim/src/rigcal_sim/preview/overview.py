"""The rig among its boards, with what its sensors can see: from above, from the side, and near."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rigcal.files import replacing
from rigcal.geometry import se3
from rigcal.geometry.directions import sphere
from rigcal.geometry.se3 import Array
from rigcal.plugin import SensorConfig, SensorType
from rigcal_sim.preview.style import COLOURS, INK, QUIET, frame_box, metric_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_VIEWS = (("from above", 0, 1), ("from the side", 0, 2))
_DIRECTIONS = 160_000
_SECTORS = 180
_REACH = 0.85
_AXES_COLOURS = ("#c0392b", "#27ae60", "#2464b4")


def write_overview(
    path: Path,
    title: str,
    sensors: Mapping[str, tuple[SensorType, SensorConfig, Array]],
    boards: Array,
) -> None:
    """A PNG of the sensors, given by type, config and `T_l_s`, and outlines (N, K, 3) of boards.

    All in a level frame l, z up. A field of view is what the plugin's `sees` says, drawn as far as
    the boards stand.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure((15, 13), dpi=100, facecolor="white")
    FigureCanvasAgg(figure)
    figure.text(0.012, 0.975, title, fontsize=13, color=INK, va="center")
    poses = {name: T for name, (_, _, T) in sensors.items()}
    fields = {
        name: field_of_view(kind, config, T, boards) for name, (kind, config, T) in sensors.items()
    }
    flat = [name for name, (kind, _, _) in sensors.items() if kind.flat]
    for column, (label, i, j) in enumerate(_VIEWS):
        far = figure.add_axes((0.05 + 0.475 * column, 0.46, 0.44, 0.47))
        far.set_title(f"fields of view and all boards, {label}", fontsize=10, color=INK)
        _draw_boards(far, boards, i, j)
        _draw_fields(far, fields, poses, flat, i, j)
        near = figure.add_axes((0.05 + 0.475 * column, 0.05, 0.36, 0.33))
        near.set_title(f"the rig, {label}; axes x red, y green, z blue", fontsize=10, color=INK)
        _draw_rig(near, poses, i, j)
        for axes in (far, near):
            metric_axes(axes, f"{'xyz'[i]} [m]", f"{'xyz'[j]} [m]")
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", metadata={"Software": None})


def field_of_view(kind: SensorType, config: SensorConfig, T_l_s: Array, boards: Array) -> Array:
    """Points (N, 3) in frame l, in directions all around that the sensor sees.

    They lie at 0.85 of the boards' middle distance, nearer for a sensor that does not reach so far.
    """
    directions = _circle() if kind.flat else sphere(_DIRECTIONS)
    middles = boards.mean(axis=1) - T_l_s[:3, 3]
    reach = _REACH * float(np.median(np.linalg.norm(middles, axis=1)))
    for _ in range(8):
        seen = np.ones(len(directions), bool)
        if kind.sees is not None:
            seen = kind.sees(reach * directions, config)
        if seen.any():
            return se3.apply(T_l_s, reach * directions[seen])
        reach /= 2
    return T_l_s[None, :3, 3]


def sector_of(points: Array, place: Array) -> Array:
    """The outline (M, 2) of what points (N, 2) seen from a place (2,) cover: how far in each of
    180 directions.
    """
    d = points - place
    angle = np.arctan2(d[:, 1], d[:, 0])
    index = np.floor((angle + np.pi) / (2 * np.pi) * _SECTORS).astype(np.intp) % _SECTORS
    reach = np.zeros(_SECTORS)
    np.maximum.at(reach, index, np.linalg.norm(d, axis=1))
    middle = -np.pi + (np.arange(_SECTORS) + 0.5) * 2 * np.pi / _SECTORS
    result: Array = place + reach[:, None] * np.column_stack([np.cos(middle), np.sin(middle)])
    return result


def fan_of(points: Array, place: Array) -> Array:
    """The outline (M, 3) of a flat field: its points (N, 3), in the order of their angles, and the
    place (3,) where the widest gap between them is.
    """
    gaps = np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1)
    ordered = np.roll(points, -int(np.argmax(gaps)), axis=0)
    return ordered if gaps.max() < 2 * np.median(gaps) else np.concatenate([ordered, place[None]])


def _circle() -> Array:
    """Unit directions all around in the plane z = 0."""
    turn = np.linspace(-np.pi, np.pi, 4 * _SECTORS, endpoint=False)
    return np.column_stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)])


def _draw_boards(axes: Axes, boards: Array, i: int, j: int) -> None:
    from matplotlib.collections import PolyCollection

    outlines = [board[:, [i, j]] for board in boards]
    axes.add_collection(
        PolyCollection(outlines, facecolors="#8a949e18", edgecolors=QUIET, linewidths=0.5)
    )


def _draw_fields(
    axes: Axes,
    fields: Mapping[str, Array],
    poses: Mapping[str, Array],
    flat: Sequence[str],
    i: int,
    j: int,
) -> None:
    for colour, (name, field) in zip(_colours(len(fields)), fields.items(), strict=True):
        place = poses[name][:3, 3]
        if name in flat:
            outline = fan_of(field, place)[:, [i, j]]
        else:
            outline = sector_of(field[:, [i, j]], place[[i, j]])
        axes.fill(*outline.T, facecolor=colour, alpha=0.07)
        axes.fill(*outline.T, facecolor="none", edgecolor=colour, lw=1.0, alpha=0.85)
        axes.plot(*place[[i, j]], "o", ms=3, color=colour, zorder=3)
    axes.autoscale_view()
    low, high = axes.dataLim.get_points()
    frame_box(axes, low - 0.15, high + 0.15)


def _draw_rig(axes: Axes, poses: Mapping[str, Array], i: int, j: int) -> None:
    """Each sensor with its axes; the names stand beside the picture, in the order of the places."""
    places = np.array([T[[i, j], 3] for T in poses.values()])
    size = max(float(np.ptp(places, axis=0).max()), 0.2)
    frame_box(axes, places.min(axis=0) - 0.25 * size, places.max(axis=0) + 0.25 * size)
    heights = np.empty(len(places))
    heights[np.argsort(places[:, 1], kind="stable")] = np.linspace(0.06, 0.94, len(places))
    colours = _colours(len(places))
    for (name, T), colour, height in zip(poses.items(), colours, heights, strict=True):
        for tip, axis in zip(se3.apply(T, 0.16 * size * np.eye(3)), _AXES_COLOURS, strict=True):
            axes.plot([T[i, 3], tip[i]], [T[j, 3], tip[j]], color=axis, lw=1.3)
        axes.plot(T[i, 3], T[j, 3], "o", ms=5, color=colour, zorder=3)
        axes.annotate(
            name,
            (float(T[i, 3]), float(T[j, 3])),
            (1.02, height),
            textcoords="axes fraction",
            va="center",
            color=colour,
            arrowprops={"arrowstyle": "-", "color": colour, "lw": 0.5, "alpha": 0.6},
        )


def _colours(count: int) -> list[str]:
    return [COLOURS[k % len(COLOURS)] for k in range(count)]
