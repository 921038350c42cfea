"""The study's figures as box plots over runs, in the manner of MSG-Cal's."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rigcal.files import replacing
from rigcal.geometry.se3 import Array
from rigcal_sim.experiment.run import Row, select

_NAMES = {"pairwise": "pairwise", "msgcal": "graph\n(msgcal)", "joint": "joint"}
_INK, _MEDIAN, _MEAN = "#222222", "#c0392b", "#2464b4"


@dataclass(frozen=True)
class _Box:
    """One box: its label and which rows are in it."""

    label: str
    where: dict[str, Any]


@dataclass(frozen=True)
class _Plot:
    """One figure: a column of the rows, in units, as boxes side by side."""

    name: str
    title: str
    column: str
    factor: float
    unit: str
    boxes: tuple[_Box, ...]


_STAGES = tuple(
    _Box(label, {"formulation": f, "filtered": True, "initial": "tree"})
    for f, label in _NAMES.items()
)
_FILTER = tuple(
    _Box(f"{_NAMES[f]}\n{word}", {"formulation": f, "filtered": kept, "initial": "tree"})
    for f in ("msgcal", "joint")
    for kept, word in ((True, "filtered"), (False, "all data"))
)
_START = tuple(
    _Box(f"{_NAMES[f]}\n{start}", {"formulation": f, "filtered": True, "initial": start})
    for f in ("msgcal", "joint")
    for start in ("tree", "identity")
)
_MM, _DEG, _MM2 = (1e3, "mm"), (float(np.degrees(1.0)), "deg"), (1e6, "mm$^2$")
_WITH_TRUTH = (
    _Plot("a_translation", "Mean translation error", "mean_translation_m", *_MM, _STAGES),
    _Plot("b_angle", "Mean angle error", "mean_axis_rad", *_DEG, _STAGES),
    _Plot("c_graph_error", "Graph error", "graph_error_m2", *_MM2, _STAGES),
    _Plot("e_filter", "Mean translation error", "mean_translation_m", *_MM, _FILTER),
    _Plot("e_filter_graph_error", "Graph error", "graph_error_m2", *_MM2, _FILTER),
    _Plot("start", "Mean translation error", "mean_translation_m", *_MM, _START),
)
_WITHOUT_TRUTH = (
    _Plot("d_graph_error", "Graph error", "graph_error_m2", *_MM2, _STAGES),
    _Plot("f_filter", "Graph error", "graph_error_m2", *_MM2, _FILTER),
    _Plot("start", "Graph error", "graph_error_m2", *_MM2, _START),
)


def write_figures(rows: Sequence[Row], folder: Path) -> list[Path]:
    """One SVG and one PNG per figure and source, with a panel per share of outliers."""
    paths: list[Path] = []
    for source in dict.fromkeys(r.source for r in rows):
        own = [r for r in rows if r.source == source]
        has_truth = np.isfinite(select(own, "mean_translation_m")).any()
        for plot in _WITH_TRUTH if has_truth else _WITHOUT_TRUTH:
            paths += _write(plot, own, folder / f"{plot.name}_{source}")
    return paths


def _write(plot: _Plot, rows: Sequence[Row], stem: Path) -> Iterator[Path]:
    import matplotlib
    from matplotlib.figure import Figure

    shares = sorted({r.outliers for r in rows})
    # Ids, fonts and dates that do not change: the same rows give the same bytes.
    with matplotlib.rc_context({"svg.hashsalt": "rigcal", "svg.fonttype": "none"}):
        figure = Figure(figsize=(1.6 + 1.1 * len(plot.boxes) * len(shares), 3.6))
        panels = figure.subplots(1, len(shares), squeeze=False)[0]
        for axes, share in zip(panels, shares, strict=True):
            _draw(axes, plot, [r for r in rows if r.outliers == share])
            axes.set_title(f"{plot.title}, {100 * share:.0f} % outliers", fontsize=9, color=_INK)
        figure.tight_layout()
        for suffix, options in ((".svg", {"metadata": {"Date": None}}), (".png", {"dpi": 150})):
            path = stem.with_name(stem.name + suffix)
            with replacing(path) as temporary:
                figure.savefig(temporary, format=suffix[1:], **options)
            yield path


def _draw(axes: Any, plot: _Plot, rows: Sequence[Row]) -> None:
    runs = len({r.seed for r in rows})
    values = [plot.factor * _finite(select(rows, plot.column, **b.where)) for b in plot.boxes]
    axes.boxplot(
        values,
        widths=0.55,
        showmeans=True,
        medianprops={"color": _MEDIAN},
        meanprops={"marker": "x", "markeredgecolor": _MEAN, "markersize": 5},
        flierprops={"marker": "+", "markeredgecolor": _INK, "markersize": 5},
    )
    labels = [
        box.label + (f"\n{runs - len(v)} of {runs} failed" if len(v) < runs else "")
        for box, v in zip(plot.boxes, values, strict=True)
    ]
    axes.set_xticks(range(1, len(labels) + 1), labels, fontsize=8)
    axes.set_ylabel(f"[{plot.unit}]", fontsize=9)
    axes.tick_params(axis="y", labelsize=8)
    axes.grid(axis="y", color="#e6e9ec")
    axes.set_axisbelow(True)
    seen = np.concatenate(values) if any(len(v) for v in values) else np.ones(1)
    if seen.min() > 0 and seen.max() > 20 * seen.min():
        axes.set_yscale("log")
    else:
        axes.set_ylim(bottom=0)


def _finite(values: Sequence[float]) -> Array:
    array = np.asarray(values, dtype=np.float64)
    result: Array = array[np.isfinite(array)]
    return result
