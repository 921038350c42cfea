"""Figures of one sensor's errors as PNG: the same errors give the same bytes."""

from __future__ import annotations

import base64
import io
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry.se3 import Array
from rigcal.plugin.contract import SensorConfig, SensorType
from rigcal.report.sensor_errors import SensorErrors, rms_by

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, QUIET, DATA, CURVE = "#222222", "#9aa7b4", "#2464b4", "#c0392b"
_DPI = 100
_SCALES = {"m": (1000.0, "mm")}
_ARROWS = 1500
_DOTS = 6000
_BINS = 12


def error_figure(data: SensorErrors, kind: SensorType, config: SensorConfig, order: Array) -> str:
    """One picture as a data URI: distribution, place, range, incidence, exposure.

    `order` (K,) are the positions of the errors' exposures among all exposures of the calibration.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.5, 5.0), dpi=_DPI)
    grid = figure.add_gridspec(
        2, 3, width_ratios=(1.0, 1.25, 1.0),
        left=0.05, right=0.99, bottom=0.1, top=0.94, wspace=0.24, hspace=0.42,
    )  # fmt: skip
    factor, unit = _SCALES.get(data.unit, (1.0, data.unit))
    _distribution(figure.add_subplot(grid[0, 0]), data)
    _exposures(figure.add_subplot(grid[1, 0]), data, order, factor, unit)
    place = figure.add_subplot(grid[:, 1])
    if data.points is None:
        place.axis("off")
        place.text(0.5, 0.5, "the sensor type does not tell\nwhere it measured", ha="center")
        return _png(figure)
    if kind.project is not None and data.errors.shape[1] == 2:
        _image_plane(place, data, *kind.project(data.points, config), factor, unit)
    elif kind.flat:
        _scan_plane(place, data, factor, unit)
    else:
        _directions(place, data, factor, unit)
    ranges = np.linalg.norm(data.points, axis=1)
    _over(figure.add_subplot(grid[0, 2]), data, ranges, "range [m]", factor, unit)
    tilt = np.degrees(data.incidence)
    _over(figure.add_subplot(grid[1, 2]), data, tilt, "incidence [deg]", factor, unit)
    return _png(figure)


def _distribution(axes: Axes, data: SensorErrors) -> None:
    """Whitened errors against what is expected of them: a normal distribution of unit variance."""
    spread = max(float(np.sqrt(np.mean(data.whitened**2))), 1e-12)
    half = 4 * max(spread, 1.0)
    values = np.clip(data.whitened, -half, half)
    bins = int(np.clip(np.sqrt(len(values)) * 1.2, 12, 60))
    axes.hist(values, bins=bins, range=(-half, half), density=True, color=DATA, alpha=0.55)
    x = np.linspace(-half, half, 400)
    axes.plot(x, _normal(x, 1.0), color=INK, lw=1, ls="--", label="expected")
    axes.plot(x, _normal(x, spread), color=CURVE, lw=1.3, label=f"normal, {spread:.2g} as wide")
    axes.set_ylim(0, 1.9 * _normal(np.zeros(1), spread)[0])
    axes.legend(fontsize=7, frameon=False, loc="upper right")
    _labels(axes, "whitened errors", "error / configured sigma", "")
    axes.set_yticks([])


def _normal(x: Array, sigma: float) -> Array:
    result: Array = np.exp(-0.5 * (x / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))
    return result


def _exposures(axes: Axes, data: SensorErrors, order: Array, factor: float, unit: str) -> None:
    rms = factor * rms_by(data.exposure, data.sizes, len(data.exposures))
    axes.bar(order, rms, width=0.8, color=DATA, alpha=0.7)
    _labels(axes, "per exposure", "exposure, by number", f"rms [{unit}]")


def _image_plane(
    axes: Axes, data: SensorErrors, uv: Array, inside: NDArray[np.bool_], factor: float, unit: str
) -> None:
    """Errors as arrows at their places in the image, enlarged."""
    errors = factor * data.errors
    low, high = uv[inside].min(axis=0), uv[inside].max(axis=0)
    some = _some(len(uv), _ARROWS)
    typical = max(float(np.sqrt(np.mean(errors**2))), 1e-12)
    enlarged = 0.02 * float((high - low).max()) / typical
    axes.plot(*uv[_some(len(uv), _DOTS)].T, ".", ms=1, color=QUIET, alpha=0.5)
    axes.quiver(
        *uv[some].T, *errors[some].T, angles="xy", scale_units="xy", scale=1 / enlarged,
        width=0.0018, color=DATA,
    )  # fmt: skip
    axes.invert_yaxis()
    axes.set_aspect("equal")
    title = f"errors over the image, {enlarged:.0f} times enlarged"
    _labels(axes, title, "u [px]", "v [px]")


def _scan_plane(axes: Axes, data: SensorErrors, factor: float, unit: str) -> None:
    assert data.points is not None
    _by_colour(axes, data, data.points[:, 0], data.points[:, 1], factor, unit)
    axes.plot(0, 0, "+", color=INK, ms=9)
    axes.set_aspect("equal", adjustable="datalim")
    _labels(axes, "where the board was seen, in the scan's plane", "x [m]", "y [m]")


def _directions(axes: Axes, data: SensorErrors, factor: float, unit: str) -> None:
    assert data.points is not None
    x, y, z = data.points.T
    azimuth, elevation = np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, np.hypot(x, y)))
    _by_colour(axes, data, azimuth, elevation, factor, unit)
    _labels(axes, "where the board was seen", "azimuth [deg]", "elevation [deg]")


def _by_colour(
    axes: Axes, data: SensorErrors, x: Array, y: Array, factor: float, unit: str
) -> None:
    some = _some(len(x), _DOTS)
    signed = factor * data.errors[some, 0]
    limit = 2.5 * max(float(np.sqrt(np.mean(signed**2))), 1e-12)
    dots = axes.scatter(
        x[some], y[some], s=3, c=signed, cmap="coolwarm", vmin=-limit, vmax=limit, linewidths=0
    )
    axes.figure.colorbar(dots, ax=axes, label=f"error [{unit}]", shrink=0.7)


def _over(axes: Axes, data: SensorErrors, x: Array, label: str, factor: float, unit: str) -> None:
    """Errors, their mean and their standard deviation in bins of equal numbers of measurements."""
    errors = factor * data.errors
    some = _some(len(x), _DOTS)
    values = np.linalg.norm(errors, axis=1) if errors.shape[1] > 1 else errors[:, 0]
    axes.plot(x[some], values[some], ".", ms=1.2, color=DATA, alpha=0.25)
    edges = np.unique(np.quantile(x, np.linspace(0, 1, _BINS + 1)))
    if len(edges) > 2:
        bins = np.clip(np.digitize(x, edges) - 1, 0, len(edges) - 2)
        middle = (edges[:-1] + edges[1:]) / 2
        if errors.shape[1] == 1:
            count = np.maximum(np.bincount(bins, minlength=len(middle)), 1)
            mean = np.bincount(bins, values, minlength=len(middle)) / count
            axes.plot(middle, mean, color=CURVE, lw=1.3, label="mean")
        rms = rms_by(bins, values, len(middle))
        axes.plot(middle, rms, color=INK, lw=1.2, ls="--", label="rms")
        axes.legend(fontsize=7, frameon=False, loc="upper right", ncols=2)
    limit = float(np.quantile(np.abs(values), 0.995)) * 1.3 or 1.0
    axes.set_ylim(-limit if errors.shape[1] == 1 else 0, limit)
    _labels(axes, "", label, f"error [{unit}]")


def _some(count: int, most: int) -> NDArray[np.intp]:
    """At most `most` of `count` indices, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.intp))


def _labels(axes: Axes, title: str, x: str, y: str) -> None:
    axes.set_title(title, fontsize=9, color=INK, loc="left")
    axes.set_xlabel(x, fontsize=8)
    axes.set_ylabel(y, fontsize=8)
    axes.tick_params(labelsize=7, colors=INK)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _png(figure: Figure) -> str:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()
