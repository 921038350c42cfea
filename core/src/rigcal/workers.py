"""Work spread over processes, in order, a few pieces ahead of whoever takes the results."""

from __future__ import annotations

import pickle
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from itertools import islice
from typing import Any, TypeVar

_S = TypeVar("_S")
_T = TypeVar("_T")
_R = TypeVar("_R")

_AHEAD = 2
_IDLE_S = 300
"""Loky warns of workers that end while work is handed over; its 10 s pass on a busy machine."""


def in_order(
    work: Callable[[_S, _T], _R], shared: _S, tasks: Iterable[_T], jobs: int
) -> Iterator[_R]:
    """`work(shared, task)` of every task, in the order of the tasks.

    With more than one job in worker processes, which get `shared` once. At most two results per
    process wait to be taken, so that memory does not grow with the number of tasks. Whoever stops
    taking results stops the work. A program without standard streams (a service, a window) does it
    in its own process: loky cannot start others there.
    """
    if jobs <= 1 or sys.stdout is None or sys.stderr is None:
        for task in tasks:
            yield work(shared, task)
        return
    import cloudpickle
    from loky import get_reusable_executor

    executor = get_reusable_executor(max_workers=jobs, timeout=_IDLE_S)
    data = cloudpickle.dumps(shared)  # of plugins that a script defines too
    left = iter(tasks)
    waiting = deque(executor.submit(_run, work, data, task) for task in islice(left, _AHEAD * jobs))
    try:
        while waiting:
            result = waiting.popleft().result()
            waiting.extend(executor.submit(_run, work, data, task) for task in islice(left, 1))
            yield result
    finally:
        for future in waiting:
            future.cancel()


def _run(work: Callable[[Any, Any], Any], data: bytes, task: Any) -> Any:
    """One task (in a worker process)."""
    return work(_unpickled(data), task)


@lru_cache(maxsize=1)
def _unpickled(data: bytes) -> Any:
    # Once per process: what a sensor makes of the target (its texture) is kept with the target.
    return pickle.loads(data)
