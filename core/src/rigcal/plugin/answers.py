"""What a plugin's functions answered, checked before anything rests on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.errors import ObservationError
from rigcal.geometry.se3 import Array
from rigcal.observation import (
    Candidate,
    Detection,
    LineGeometry,
    PlaneGeometry,
    PointGeometry,
    PoseGeometry,
)
from rigcal.plugin.checks import kind_of
from rigcal.plugin.contract import Residual
from rigcal.targets.target import Target

_SHAPES: dict[type, dict[str, tuple[int, ...]]] = {
    PoseGeometry: {"T_s_t": (4, 4), "covariance": (6, 6)},
    PlaneGeometry: {"normal": (3,), "d": (), "center": (3,), "covariance": (3, 3)},
    LineGeometry: {"start": (3,), "end": (3,), "covariance": (6, 6)},
    PointGeometry: {"position": (3,), "covariance": (3, 3), "target_point": (3,)},
}


def check_detection(found: object) -> None:
    """ObservationError unless it is a Detection whose candidates are whole and finite."""
    if not isinstance(found, Detection):
        raise ObservationError(f"it answered {kind_of(found)}, expected a Detection")
    for number, candidate in enumerate(found.candidates):
        try:
            _check_candidate(candidate)
        except ObservationError as error:
            raise ObservationError(f"candidate {number}: {error}") from None


def checked_fiducials(
    target: Target, found: object, who: str = ""
) -> tuple[NDArray[np.int64], Array]:
    """What `target.find` answered (or `who` says), as point indices (M,) and pixels (M, 2).

    ObservationError if it is something else, not finite, or names points that do not exist.
    """
    where = who or f"`find` of target '{target.name}'"
    if not (isinstance(found, tuple) and len(found) == 2):
        raise ObservationError(f"{where} answered {kind_of(found)}, expected (indices, pixels)")
    index, uv = np.asarray(found[0], np.int64), np.asarray(found[1], np.float64)
    if index.ndim != 1 or uv.shape != (len(index), 2):
        raise ObservationError(
            f"{where} answered shapes {index.shape} and {uv.shape}, expected (M,) and (M, 2)"
        )
    if len(index) and not (index.min() >= 0 and index.max() < len(target.points)):
        raise ObservationError(
            f"{where} answered indices {index.min()} to {index.max()}, but the target has "
            f"{len(target.points)} points"
        )
    if not np.isfinite(uv).all():
        raise ObservationError(f"{where} answered a pixel that is not finite")
    return index, uv


def check_rows(residual: Any) -> None:
    """ObservationError unless it is a residual whose rows make whole blocks."""
    if not callable(residual):
        raise ObservationError(f"it is {kind_of(residual)}, expected a rigcal.plugin.Residual")
    for name, least in (("dof", 0), ("block", 1)):
        value = getattr(residual, name, None)
        if not (isinstance(value, (int, np.integer)) and value >= least):
            found = f"{value!r}, expected a whole number of rows, at least {least}"
            raise ObservationError(f"its {name} is {found}")
    if residual.dof % residual.block:
        raise ObservationError(
            f"its dof {residual.dof} is no multiple of its block {residual.block}"
        )


def check_residual(residual: Residual, r: Array, J: Array) -> None:
    """ObservationError unless r and J, which a residual returned, are finite and of its shapes.

    Expected are (m,) and (m, 6), where m is its dof and a multiple of its block.
    """
    check_rows(residual)
    rows = residual.dof
    if np.shape(r) != (rows,) or np.shape(J) != (rows, 6):
        raise ObservationError(
            f"its residual and Jacobian have shapes {np.shape(r)} and {np.shape(J)}; expected "
            f"({rows},) and ({rows}, 6) of its dof {rows}"
        )
    for name, values in (("residual", r), ("Jacobian", J)):
        bad = np.count_nonzero(~np.isfinite(values))
        if bad:
            raise ObservationError(
                f"its {name} of shape {np.shape(values)} is not finite in {bad} of its "
                f"{np.size(values)} entries"
            )


def _check_candidate(candidate: Any) -> None:
    if not isinstance(candidate, Candidate):
        raise ObservationError(f"found {kind_of(candidate)}, expected a Candidate")
    geometry = candidate.geometry
    if type(geometry) not in _SHAPES:
        known = ", ".join(kind.__name__ for kind in _SHAPES)
        raise ObservationError(f"its geometry is {kind_of(geometry)}, expected one of {known}")
    shapes, name = _SHAPES[type(geometry)], type(geometry).__name__
    for field in fields(geometry):
        value = getattr(geometry, field.name)
        _check_numbers(f"{name}.{field.name}", value, shapes.get(field.name))
    if not isinstance(candidate.measurement, Mapping):
        raise ObservationError(
            f"its measurement is {kind_of(candidate.measurement)}, expected arrays by name"
        )
    for key, value in candidate.measurement.items():
        _check_numbers(f"measurement '{key}'", value, None)
    _check_numbers("its score", candidate.score, ())


def _check_numbers(what: str, value: Any, shape: tuple[int, ...] | None) -> None:
    array = np.asarray(value)
    if array.dtype.kind not in "biuf":
        raise ObservationError(f"{what} is {kind_of(value)}, expected numbers")
    if shape is not None and array.shape != shape:
        raise ObservationError(f"{what} has shape {array.shape}, expected {shape}")
    if not np.isfinite(array).all():
        raise ObservationError(f"{what} holds a value that is not finite")
