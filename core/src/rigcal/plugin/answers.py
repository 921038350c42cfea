"""What a plugin's functions answered, checked before anything rests on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

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
from rigcal.plugin.contract import Residual

_SHAPES: dict[type, dict[str, tuple[int, ...]]] = {
    PoseGeometry: {"T_s_t": (4, 4), "covariance": (6, 6)},
    PlaneGeometry: {"normal": (3,), "d": (), "center": (3,), "covariance": (3, 3)},
    LineGeometry: {"start": (3,), "end": (3,), "covariance": (6, 6)},
    PointGeometry: {"position": (3,), "covariance": (3, 3), "target_point": (3,)},
}


def check_detection(found: object) -> None:
    """ObservationError unless it is a Detection whose candidates are whole and finite."""
    if not isinstance(found, Detection):
        raise ObservationError(f"it answered {_kind(found)}, expected a Detection")
    for number, candidate in enumerate(found.candidates):
        try:
            _check_candidate(candidate)
        except ObservationError as error:
            raise ObservationError(f"candidate {number}: {error}") from None


def check_residual(residual: Residual, r: Array, J: Array) -> None:
    """ObservationError unless r and J, which a residual returned, are finite and of its shapes.

    Expected are (m,) and (m, 6), where m is its dof and a multiple of its block.
    """
    rows, block = residual.dof, max(residual.block, 1)
    if rows % block or np.shape(r) != (rows,) or np.shape(J) != (rows, 6):
        raise ObservationError(
            f"its residual and Jacobian have shapes {np.shape(r)} and {np.shape(J)}; expected "
            f"({rows},) and ({rows}, 6) of its dof {rows}, a multiple of its block {block}"
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
        raise ObservationError(f"found {_kind(candidate)}, expected a Candidate")
    geometry = candidate.geometry
    if type(geometry) not in _SHAPES:
        known = ", ".join(kind.__name__ for kind in _SHAPES)
        raise ObservationError(f"its geometry is {_kind(geometry)}, expected one of {known}")
    shapes, name = _SHAPES[type(geometry)], type(geometry).__name__
    for field in fields(geometry):
        value = getattr(geometry, field.name)
        _check_numbers(f"{name}.{field.name}", value, shapes.get(field.name))
    if not isinstance(candidate.measurement, Mapping):
        raise ObservationError(
            f"its measurement is {_kind(candidate.measurement)}, expected arrays by name"
        )
    for key, value in candidate.measurement.items():
        _check_numbers(f"measurement '{key}'", value, None)
    _check_numbers("its score", candidate.score, ())


def _check_numbers(what: str, value: Any, shape: tuple[int, ...] | None) -> None:
    array = np.asarray(value)
    if array.dtype.kind not in "biuf":
        raise ObservationError(f"{what} is {_kind(value)}, expected numbers")
    if shape is not None and array.shape != shape:
        raise ObservationError(f"{what} has shape {array.shape}, expected {shape}")
    if not np.isfinite(array).all():
        raise ObservationError(f"{what} holds a value that is not finite")


def _kind(value: object) -> str:
    return "nothing" if value is None else f"a {type(value).__name__}"
