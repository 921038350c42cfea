"""One run of the experiment: the same observations through every variant of the estimate."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np

from rigcal.calibration import Calibration
from rigcal.errors import RigcalError
from rigcal.estimation import finish, pairwise_calibration, prepare
from rigcal.evaluation import evaluate
from rigcal.graph.method import Formulation, Initial, Method
from rigcal.graph.msgcal import MsgcalGraph, graph_error_m2
from rigcal.plugin import Registry
from rigcal.rig import Rig
from rigcal_sim.experiment.source import Source
from rigcal_sim.features import with_outliers

_VARIANTS: tuple[tuple[bool, Initial], ...] = (
    (True, "tree"),
    (True, "identity"),
    (False, "tree"),
)
METHODS = tuple(
    Method(formulation, filtered, initial)
    for formulation in get_args(Formulation)[::-1]
    for filtered, initial in _VARIANTS
)
"""Everything but the spanning tree as it is: `msgcal` first, then `joint`."""


@dataclass(frozen=True)
class Row:
    """One variant in one run; NaN where it gave no result, or where there is no truth.

    `formulation` is "pairwise" for the spanning tree as it is. Means are over sensors; the angle
    is MSG-Cal's, between the sensors' principal axes. `problem` says why there is no result.
    """

    source: str
    outliers: float
    seed: int
    formulation: str
    filtered: bool
    initial: str
    graph_error_m2: float = float("nan")
    mean_translation_m: float = float("nan")
    mean_axis_rad: float = float("nan")
    mean_rotation_rad: float = float("nan")
    problem: str = ""


@dataclass(frozen=True)
class SensorRow:
    """The error of one sensor in one variant of one run."""

    source: str
    outliers: float
    seed: int
    formulation: str
    filtered: bool
    initial: str
    sensor: str
    translation_m: float
    rotation_rad: float
    axis_rad: float


@dataclass(frozen=True, eq=False)
class Setting:
    """What all runs share."""

    rig: Rig
    registry: Registry
    sources: tuple[Source, ...]


@dataclass(frozen=True)
class Run:
    """The index of the source, the share of outliers put in, and the seed."""

    source: int
    outliers: float
    seed: int


def run(setting: Setting, task: Run) -> tuple[list[Row], list[SensorRow]]:
    """All variants on one draw of observations."""
    source, rig = setting.sources[task.source], setting.rig
    head = Row(source.name, task.outliers, task.seed, "pairwise", True, "tree")
    drawn = source.draw(rig, setting.registry, task.seed)
    observations = with_outliers(drawn, task.outliers, _generator(task))
    try:
        stages = prepare(rig, setting.registry, observations, task.seed)
    except RigcalError as error:
        return [replace(head, problem=str(error))], []
    # One graph judges all: that of the pairs' inliers.
    graph = stages.graph()
    rows, sensor_rows = _judge(head, pairwise_calibration(stages), graph, source.truth)
    for method in METHODS:
        row = of_method(head, method)
        try:
            more, of_sensors = _judge(row, finish(stages, method), graph, source.truth)
        except RigcalError as error:
            more, of_sensors = [replace(row, problem=str(error))], []
        rows, sensor_rows = rows + more, sensor_rows + of_sensors
    return rows, sensor_rows


def of_method(row: Row, method: Method) -> Row:
    """The row, as one of a method."""
    return replace(
        row, formulation=method.formulation, filtered=method.filtered, initial=method.initial
    )


def _generator(task: Run) -> np.random.Generator:
    digest = hashlib.sha256(f"outliers/{task.seed}".encode()).digest()
    return np.random.default_rng(np.frombuffer(digest, dtype=np.uint32))


def _judge(
    row: Row, calibration: Calibration, graph: MsgcalGraph, truth: Calibration | None
) -> tuple[list[Row], list[SensorRow]]:
    T = {s: calibration.T(calibration.root, s) for s in calibration.sensors}
    row = replace(row, graph_error_m2=graph_error_m2(graph, T))
    if truth is None:
        return [row], []
    errors = evaluate(calibration, truth)
    row = replace(
        row,
        mean_translation_m=errors.mean_translation_m,
        mean_axis_rad=errors.mean_axis_rad,
        mean_rotation_rad=errors.mean_rotation_rad,
    )
    key: dict[str, Any] = {
        name: getattr(row, name)
        for name in ("source", "outliers", "seed", "formulation", "filtered", "initial")
    }
    return [row], [
        SensorRow(**key, sensor=s, translation_m=e.translation_m, rotation_rad=e.rotation_rad,
                  axis_rad=e.axis_rad)
        for s, e in errors.sensors.items()
    ]  # fmt: skip


def select(rows: Sequence[Row], column: str, **where: Any) -> list[float]:
    """A column of the rows in which all names of `where` have the given values."""
    return [
        float(getattr(row, column))
        for row in rows
        if all(getattr(row, name) == value for name, value in where.items())
    ]
