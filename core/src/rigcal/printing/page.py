"""The page: the board at true scale, cut marks, a ruler, and the target's own definition."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import Literal

import numpy as np
import yaml

from rigcal.geometry.se3 import Array
from rigcal.printing.regions import Rings, visible_regions
from rigcal.targets.target import Target

RULER_MM = 100
MM_PER_PT = 25.4 / 72
_MARGIN_MM = 15.0
_MARK_MM = (3.0, 11.0)
_TICKS_MM = {1: 1.5, 5: 2.5, 10: 4.0}
_TEXT_PT = (8.0, 20.0)
_TEXT_PT_PER_MM = 0.01
_LINE = 1.45
_ADVANCE = 0.603
"""Width of a letter of the (fixed pitch) font, in parts of its size."""


@dataclass(frozen=True)
class Text:
    """A line of text whose base line starts, or has its middle, at (x, y)."""

    x_mm: float
    y_mm: float
    text: str
    size_pt: float
    align: Literal["left", "center"] = "left"


@dataclass(frozen=True, eq=False)
class Page:
    """What is drawn, in mm from the bottom-left corner of the page, x right, y up.

    `regions` are (grey, rings): filled outlines with holes. `lines` (n, 2, 2) are strokes.
    `size_mm` is whole. `origin_mm` (2,) is where the target's frame has its origin.
    """

    size_mm: tuple[int, int]
    origin_mm: Array
    regions: tuple[tuple[float, Rings], ...]
    lines: Array
    texts: tuple[Text, ...]


def lay_out(target: Target) -> Page:
    """The page of a target: its board above, ruler and text below, and margins around."""
    low, high = 1e3 * target.outline.min(axis=0), 1e3 * target.outline.max(axis=0)
    board = high - low
    width = int(np.ceil(max(board[0], RULER_MM * 1.1) + 2 * _MARGIN_MM - 1e-6))
    size_pt = float(np.clip(width * _TEXT_PT_PER_MM, *_TEXT_PT))
    line_mm = _LINE * size_pt * MM_PER_PT
    words = _words(target, int((width - 2 * _MARGIN_MM) / (_ADVANCE * size_pt * MM_PER_PT)))
    ruler_mm = _TICKS_MM[10] + line_mm
    strip = np.ceil(_MARGIN_MM + ruler_mm + (len(words) + 0.5) * line_mm)
    bottom = _MARGIN_MM + float(strip)
    origin = np.array([(width - board[0]) / 2, bottom]) - low
    ruler_y = bottom - _MARGIN_MM - ruler_mm
    ruler, labels = _ruler(_MARGIN_MM, ruler_y, size_pt)
    first_y = ruler_y - 1.5 * line_mm
    texts = [Text(_MARGIN_MM, first_y - i * line_mm, word, size_pt) for i, word in enumerate(words)]
    return Page(
        size_mm=(width, int(np.ceil(bottom + board[1] + _MARGIN_MM - 1e-6))),
        origin_mm=origin,
        regions=tuple(
            (grey, [origin + 1e3 * ring for ring in rings])
            for grey, rings in visible_regions(target.patches)
        ),
        lines=np.concatenate([_cut_marks(origin + 1e3 * target.outline), ruler]),
        texts=(*labels, *texts),
    )


def definition(target: Target) -> str:
    """The target as one line of YAML, to stand below `targets:` in rig.yaml."""
    fields = target.config.model_dump(mode="json", exclude_none=True)
    flow = yaml.safe_dump(fields, default_flow_style=True, sort_keys=False, width=float("inf"))
    return f"{target.name}: {flow.strip()}"


def _words(target: Target, columns: int) -> list[str]:
    """The lines below the ruler, of `columns` letters at most."""
    width, height = 1e3 * target.size
    notes = (
        f"Print at 100 %: the ruler must measure {RULER_MM} mm. "
        f"Cut at the marks: {width:.6g} x {height:.6g} mm.",
        "In rig.yaml, below targets:",
    )
    lines = [line for note in notes for line in textwrap.wrap(note, columns)]
    # A key and its value stay in one line.
    tied = definition(target).replace(": ", ":\u00a0")
    wrapped = textwrap.wrap(
        tied, columns, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )
    return lines + [line.replace("\u00a0", " ") for line in wrapped]


def _cut_marks(outline: Array) -> Array:
    """Two strokes at each corner of the outline (n, 2), in line with its edges, outside it."""
    edge = np.roll(outline, -1, axis=0) - outline
    along = edge / np.linalg.norm(edge, axis=1, keepdims=True)
    near, far = _MARK_MM
    backward = np.stack([outline - near * along, outline - far * along], axis=1)
    end = np.roll(outline, -1, axis=0)
    forward = np.stack([end + near * along, end + far * along], axis=1)
    return np.concatenate([backward, forward])


def _ruler(x: float, y: float, size_pt: float) -> tuple[Array, list[Text]]:
    """Strokes and labels of a ruler whose zero is at (x, y), ticks upwards."""
    at = np.arange(RULER_MM + 1)
    tick = np.select([at % step == 0 for step in (10, 5)], [_TICKS_MM[10], _TICKS_MM[5]], 1.5)
    foot = np.stack([x + at, np.full(len(at), y)], axis=-1)
    ticks = np.stack([foot, foot + np.stack([0 * tick, tick], axis=-1)], axis=1)
    base = foot[None, [0, -1]]
    above = y + _TICKS_MM[10] + 0.3 * size_pt * MM_PER_PT
    labels = [
        Text(x + mm, above, label, size_pt, "center")
        for mm, label in ((0, "0"), (50, "50"), (100, "100 mm"))
    ]
    return np.concatenate([base, ticks]), labels
