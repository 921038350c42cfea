"""A plan as a picture: the rig, what is recorded, and the board poses proposed, numbered."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rigcal.errors import InputError
from rigcal.files import replacing
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.planning import Plan
from rigcal.planning.site import body_axes
from rigcal.plugin.registry import Registry
from rigcal.report.figures import SETTINGS
from rigcal.report.view import rims
from rigcal.rig import Rig, build_targets
from rigcal.targets.target import Target

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_INK, _QUIET, _GRID, _BOARD = "#222222", "#8a949e", "#e6e9ec", "#c0392b"
_COLOURS = (
    "#2464b4", "#e8810c", "#27913c", "#8e44ad", "#0d98a8",
    "#b8860b", "#6b7785", "#7cb518", "#5f3dc4", "#a0522d",
)  # fmt: skip
_SUFFIXES = (".png", ".svg")
_VIEWS = (("from above", 0, 1), ("from the side", 0, 2))
_REACH = 0.5
"""Fields of view are drawn to this share of the boards' middle distance."""
_ARROW_M = 0.3


def check_picture(path: Path | str) -> Path:
    """The path; InputError for one of another suffix than a picture's."""
    path = Path(path)
    if path.suffix.lower() not in _SUFFIXES:
        raise InputError(f"{path}: a picture is a file that ends in .png or .svg")
    return path


def write_plan_picture(path: Path | str, plan: Plan, rig: Rig, registry: Registry) -> None:
    """Write a PNG or an SVG, as the suffix says; InputError for another one.

    The frame is level, z up, x the root's forward direction, its origin the root's.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    path = check_picture(path)
    # Text stays text in an SVG, and its ids are the same on every run.
    with (
        SETTINGS,
        rc_context({"svg.fonttype": "none", "svg.hashsalt": "rigcal"}),
        replacing(path) as file,
    ):
        figure = Figure((15, 8.6), dpi=100, facecolor="white")
        FigureCanvasAgg(figure)
        _draw(figure, plan, rig, registry)
        kind = path.suffix.lower().removeprefix(".")
        empty = {"png": {"Software": None}, "svg": {"Date": None}}[kind]
        figure.savefig(file, format=kind, metadata=empty)


def _draw(figure: Any, plan: Plan, rig: Rig, registry: Registry) -> None:
    targets = build_targets(rig, registry)
    R_l_root = _level(plan, rig)
    T_l_root = se3.transform(R_l_root, np.zeros(3))
    recorded = [_outline(T_l_root @ T, targets[name]) for name, T in plan.boards]
    proposed = [T_l_root @ p.T_root_t for p in plan.proposals]
    outlines = [
        _outline(T, targets[p.target]) for T, p in zip(proposed, plan.proposals, strict=True)
    ]
    what = "recorded" if plan.recorded is not None else "an example of what is predicted for"
    figure.text(
        0.012, 0.97, f"{rig.name}: {len(plan.T_root_s)} sensors; grey: {len(recorded)} boards, "
        f"{what}{'; red: what to show next' if proposed else ''}",
        fontsize=13, color=_INK, va="center",
    )  # fmt: skip
    poses = {name: T_l_root @ T for name, T in plan.T_root_s.items()}
    fields = _fields(poses, rig, registry, [*recorded, *outlines])
    bottom = 0.145 + 0.034 * len(proposed)
    for (label, i, j), left in zip(_VIEWS, (0.04, 0.53), strict=True):
        axes = figure.add_axes((left, bottom, 0.45, 0.89 - bottom))
        axes.set_title(label, fontsize=10, color=_INK)
        _draw_boards(axes, recorded, i, j)
        _draw_sensors(axes, poses, fields, i, j)
        _draw_proposals(axes, proposed, outlines, i, j)
        _metric(axes, f"{'xyz'[i]} [m]", f"{'xyz'[j]} [m]")
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="lower left", bbox_to_anchor=(0.03, bottom - 0.115),
        ncols=10, frameon=False, fontsize=9,
    )  # fmt: skip
    for k, proposal in enumerate(plan.proposals):
        text = f"{k + 1}  {proposal.words}  (seen by {', '.join(proposal.seen_by)})"
        figure.text(0.04, bottom - 0.135 - 0.032 * k, text, fontsize=9, color=_INK, va="center")


def _level(plan: Plan, rig: Rig) -> Array:
    """`R_l_root` (3, 3): z up, x the root's forward direction made level."""
    forward, left, _ = body_axes(rig.sensors[rig.root]).T
    ahead = forward if abs(forward @ plan.up) < 0.9 else left
    ahead = ahead - (ahead @ plan.up) * plan.up
    ahead /= np.linalg.norm(ahead)
    result: Array = np.stack([ahead, np.cross(plan.up, ahead), plan.up])
    return result


def _outline(T_l_t: Array, target: Target) -> Array:
    return se3.apply(T_l_t, target.outline_points)


def _fields(
    poses: dict[str, Array], rig: Rig, registry: Registry, boards: Sequence[Array]
) -> dict[str, list[Array]]:
    """By sensor, the rims of its field of view."""
    middles = np.array([board.mean(axis=0) for board in boards]).reshape(-1, 3)
    distances = np.linalg.norm(middles, axis=1)
    reach = _REACH * float(np.median(distances)) if len(distances) else 1.0
    return {
        name: [
            se3.apply(T, curve)
            for config in [rig.sensors[name]]
            for curve in rims(registry.sensor_type(config.type), config, reach)
        ]
        for name, T in poses.items()
    }


def _draw_boards(axes: Axes, boards: Sequence[Array], i: int, j: int) -> None:
    from matplotlib.collections import PolyCollection

    axes.add_collection(
        PolyCollection(
            [board[:, [i, j]] for board in boards],
            facecolors=(_QUIET, min(0.15, 4 / max(len(boards), 1))), edgecolors=(_QUIET, 0.6),
            linewidths=0.6,
        )
    )  # fmt: skip


def _draw_sensors(
    axes: Axes, poses: dict[str, Array], fields: dict[str, list[Array]], i: int, j: int
) -> None:
    for k, (name, T) in enumerate(poses.items()):
        colour = _COLOURS[k % len(_COLOURS)]
        for curve in fields[name]:
            axes.plot(curve[:, i], curve[:, j], color=colour, lw=0.9, alpha=0.7)
        axes.plot(T[i, 3], T[j, 3], "o", ms=5, color=colour, zorder=3, label=name)


def _draw_proposals(
    axes: Axes, poses: Sequence[Array], outlines: Sequence[Array], i: int, j: int
) -> None:
    """Each board, an arrow out of its face, and its number."""
    for k, (T, outline) in enumerate(zip(poses, outlines, strict=True)):
        axes.fill(
            outline[:, i],
            outline[:, j],
            facecolor=f"{_BOARD}30",
            edgecolor=_BOARD,
            lw=1.8,
            zorder=4,
        )
        tip = T[:3, 3] + _ARROW_M * T[:3, 2]
        axes.annotate(
            "", (tip[i], tip[j]), (T[i, 3], T[j, 3]), zorder=5,
            arrowprops={"arrowstyle": "->", "color": _BOARD, "lw": 1.4},
        )  # fmt: skip
        back = T[:3, 3] - 0.6 * _ARROW_M * T[:3, 2]
        axes.text(
            back[i], back[j], str(k + 1), color="white", fontsize=10, weight="bold",
            ha="center", va="center", zorder=6,
            bbox={"boxstyle": "circle,pad=0.25", "facecolor": _BOARD, "edgecolor": "white"},
        )  # fmt: skip


def _metric(axes: Axes, across: str, up: str) -> None:
    """Equal scales in metres, a quiet grid behind, all that is drawn within."""
    axes.autoscale_view()
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.05)
    axes.set_xlabel(across, fontsize=8, color=_INK, labelpad=1)
    axes.set_ylabel(up, fontsize=8, color=_INK, labelpad=1)
    axes.tick_params(labelsize=7, colors=_INK, length=2)
    axes.grid(color=_GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
