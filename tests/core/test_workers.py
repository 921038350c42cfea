"""Results come in order, and no more of them wait than a few."""

from __future__ import annotations

from collections.abc import Iterator
from operator import mul, truediv

import pytest

from rigcal.workers import in_order


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_are_in_the_order_of_the_tasks(jobs: int) -> None:
    assert list(in_order(mul, 3, range(20), jobs)) == [3 * k for k in range(20)]


@pytest.mark.parametrize("jobs", [1, 2])
def test_tasks_are_taken_only_as_results_are(jobs: int) -> None:
    taken = []

    def tasks() -> Iterator[int]:
        for number in range(100):
            taken.append(number)
            yield number

    results = in_order(mul, 1, tasks(), jobs)
    for expected in range(10):
        assert next(results) == expected
        assert len(taken) <= expected + 1 + 2 * jobs
    results.close()  # type: ignore[attr-defined]


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_error_reaches_the_caller(jobs: int) -> None:
    with pytest.raises(ZeroDivisionError):
        list(in_order(truediv, 1, [1, 0, 2], jobs))
