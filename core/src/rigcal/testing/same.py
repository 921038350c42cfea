"""Whether two frames, whatever a plugin makes them of, say the same."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np


def assert_same(first: Any, second: Any, tolerance: float = 0.0, where: str = "the frame") -> None:
    """AssertionError unless equal: arrays and numbers to a relative and absolute `tolerance`,
    images (uint8) to one level where `tolerance` is above 0.

    Looks into dataclasses, mappings, sequences and objects with attributes.
    """
    if isinstance(first, np.ndarray | np.generic | float):
        _assert_same_numbers(np.asarray(first), np.asarray(second), tolerance, where)
        return
    assert type(first).__name__ == type(second).__name__, f"{where}: {first!r} and {second!r}"
    if isinstance(first, Mapping):
        assert first.keys() == second.keys(), where
        parts = {f"{where}[{k!r}]": (first[k], second[k]) for k in first}
    elif isinstance(first, list | tuple):
        assert len(first) == len(second), f"{where}: {len(first)} and {len(second)} items"
        parts = {f"{where}[{i}]": pair for i, pair in enumerate(zip(first, second, strict=True))}
    elif dataclasses.is_dataclass(first) or hasattr(first, "__dict__"):
        names = [n for n in _names(first) if not n.startswith("_")]
        parts = {f"{where}.{n}": (getattr(first, n), getattr(second, n)) for n in names}
    else:
        assert first == second, f"{where}: {first!r} and {second!r}"
        return
    for name, (a, b) in parts.items():
        assert_same(a, b, tolerance, name)


def _names(value: Any) -> list[str]:
    if dataclasses.is_dataclass(value):
        return [field.name for field in dataclasses.fields(value)]
    return list(vars(value))


def _assert_same_numbers(a: Any, b: Any, tolerance: float, where: str) -> None:
    assert a.shape == b.shape, f"{where}: shapes {a.shape} and {b.shape}"
    if a.dtype == np.uint8 and tolerance > 0:
        np.testing.assert_allclose(a.astype(int), b.astype(int), atol=1, err_msg=where)
    elif tolerance > 0 and a.dtype.kind in "fc":
        np.testing.assert_allclose(a, b, rtol=tolerance, atol=tolerance, err_msg=where)
    else:
        np.testing.assert_array_equal(a, b, err_msg=where)
