"""What one sensor saw, as one panel: an image with corners, a scan in its plane, a cloud."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import inside_convex
from rigcal.plugin import FrameView, SensorConfig, SensorType
from rigcal.targets import Target
from rigcal.visibility import cut
from rigcal_sim.preview.oblique import oblique_view
from rigcal_sim.preview.style import BOARD, INK, QUIET, frame_box, metric_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_IMAGE_PX = 640
_MARGIN_M = 0.35
_THICK_M = 0.1
_EDGE_STEPS = np.linspace(0.0, 1.0, 33)[:-1]


@dataclass(frozen=True, eq=False)
class Sensor:
    """One sensor and where the board stood: `R_l_s` (3, 3) takes its axes to level ones."""

    name: str
    kind: SensorType
    config: SensorConfig
    target: Target
    T_s_t: Array
    R_l_s: Array

    @property
    def shows_face(self) -> bool:
        """Whether the sensor is in front of the board."""
        return bool(self.T_s_t[:3, 2] @ self.T_s_t[:3, 3] < 0)

    @property
    def outline(self) -> Array:
        """(K, 3) points around the board."""
        corners = self.target.outline_points
        sides = np.roll(corners, -1, axis=0) - corners
        around = corners[:, None] + _EDGE_STEPS[:, None] * sides[:, None]
        return se3.apply(self.T_s_t, around.reshape(-1, 3))


def draw_panel(axes: Axes, sensor: Sensor, view: FrameView | str) -> None:
    """Draw what a sensor saw, or say why not."""
    if isinstance(view, str):
        _say(axes, sensor, view)
    elif view.image is not None:
        _draw_image(axes, sensor, view.image)
    elif view.points is None:
        _say(axes, sensor, "its view is empty")
    elif sensor.kind.flat:
        _draw_scan(axes, sensor, view.points)
    else:
        _draw_cloud(axes, sensor, view.points)


def _say(axes: Axes, sensor: Sensor, why: str) -> None:
    axes.set_axis_off()
    axes.text(0.5, 0.5, why, ha="center", va="center", fontsize=8, color=QUIET, wrap=True)
    _title(axes, sensor.name, "")


def _title(axes: Axes, name: str, note: str) -> None:
    axes.set_title(f"{name}  ", loc="left", fontsize=10, color=INK, fontweight="bold", pad=4)
    axes.set_title(note, loc="right", fontsize=8, color=INK if note else QUIET, pad=4)


def _draw_image(axes: Axes, sensor: Sensor, image: NDArray[np.uint8]) -> None:
    """The image with the true corners on it."""
    height, width = image.shape[:2]
    grey: Any = {"cmap": "gray", "vmin": 0, "vmax": 255} if image.ndim == 2 else {}
    extent = (-0.5, width - 0.5, height - 0.5, -0.5)
    axes.imshow(_reduced(image), extent=extent, interpolation="nearest", **grey)
    axes.set_xticks([])
    axes.set_yticks([])
    note = ""
    if sensor.kind.project is not None:
        uv, seen = sensor.kind.project(sensor.outline, sensor.config)
        axes.plot(*np.where(seen[:, None], uv, np.nan)[[*range(len(uv)), 0]].T, color=BOARD, lw=1)
        points = se3.apply(sensor.T_s_t, sensor.target.points)
        uv, seen = sensor.kind.project(points, sensor.config)
        if seen.any() and sensor.shows_face:
            axes.plot(*uv[seen].T, "o", ms=2.6, mfc="none", mec="#22c55e", mew=0.7)
            note = f"{np.count_nonzero(seen)} of {len(uv)} corners in the image"
        else:
            note = "the back of the board" if seen.any() else "no corner of the board in the image"
    axes.set_xlim(*extent[:2])
    axes.set_ylim(*extent[2:])
    _title(axes, sensor.name, note)


def _reduced(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The image at less than 960 px: the means of squares of pixels."""
    side = max(1, round(max(image.shape[:2]) / _IMAGE_PX))
    rows, columns = (size // side for size in image.shape[:2])
    squares = image[: rows * side, : columns * side].reshape(rows, side, columns, side, -1)
    mean = squares.mean(axis=(1, 3)).round().reshape(rows, columns, *image.shape[2:])
    reduced: NDArray[np.uint8] = mean.astype(np.uint8)
    return reduced


def _draw_scan(axes: Axes, sensor: Sensor, points: Array) -> None:
    """The scan in its plane with the line in which the board cuts it."""
    metric_axes(axes, "x [m]", "y [m]")
    chord = cut(sensor.T_s_t, sensor.target)
    near = np.concatenate([sensor.outline[:, :2], [[0.0, 0.0]]])
    frame_box(axes, near.min(axis=0) - _MARGIN_M, near.max(axis=0) + _MARGIN_M)
    on_board = _on_board(sensor, points)
    axes.plot(*points[~on_board, :2].T, ".", ms=1.6, color=QUIET)
    axes.plot(*points[on_board, :2].T, ".", ms=2.4, color="#2464b4")
    axes.plot(*sensor.outline[[*range(len(sensor.outline)), 0], :2].T, ":", lw=0.7, color=BOARD)
    if len(chord):
        axes.plot(*chord[:, :2].T, color=BOARD, lw=1)
    axes.plot(0, 0, "o", ms=4, color=INK)
    axes.annotate("", (0.25, 0), (0, 0), arrowprops={"arrowstyle": "->", "color": INK})
    missed = "the scan's plane misses the board"
    _title(axes, sensor.name, _in_numbers(sensor, points[on_board]) if len(chord) else missed)


def _draw_cloud(axes: Axes, sensor: Sensor, points: Array) -> None:
    """The cloud around sensor and board from behind the sensor, coloured by range."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.patches import Rectangle

    picture = oblique_view(points, sensor.outline, sensor.R_l_s)
    axes.imshow(picture.pixels, extent=picture.extent, interpolation="nearest")
    axes.plot(*picture.outline[[*range(len(picture.outline)), 0]].T, color=BOARD, lw=1)
    axes.plot(*picture.origin, "o", ms=4, color=INK)
    axes.set_xlim(*picture.extent[:2])
    axes.set_ylim(*picture.extent[2:])
    axes.set_xticks([])
    axes.set_yticks([])
    colours = ScalarMappable(picture.norm, picture.colours)
    axes.add_patch(
        Rectangle((0.88, 0.015), 0.11, 0.5, transform=axes.transAxes, fc="white", alpha=0.85)
    )
    bar = axes.inset_axes((0.955, 0.05, 0.02, 0.4))
    axes.figure.colorbar(colours, cax=bar)
    bar.tick_params(labelsize=6, length=2, left=True, labelleft=True, right=False, labelright=False)
    bar.set_title("m", fontsize=6, pad=2)
    _title(axes, sensor.name, _in_numbers(sensor, points[_on_board(sensor, points)]))


def _on_board(sensor: Sensor, points: Array) -> NDArray[np.bool_]:
    """Which points (N,) lie within the board's outline, and near its plane."""
    p_t = se3.apply(se3.inverse(sensor.T_s_t), points)
    on_board: NDArray[np.bool_] = inside_convex(p_t[:, :2], sensor.target.outline)
    return on_board & (np.abs(p_t[:, 2]) < _THICK_M)


def _in_numbers(sensor: Sensor, on_board: Array) -> str:
    if not len(on_board):
        return "no return from the board"
    off = se3.apply(se3.inverse(sensor.T_s_t), on_board)[:, 2]
    side = "the board" if sensor.shows_face else "the board's back"
    rms_mm = 1e3 * float(np.sqrt(np.mean(off**2)))
    returns = "1 return" if len(off) == 1 else f"{len(off)} returns"
    return f"{returns} from {side}, {rms_mm:.1f} mm rms off it"
