"""Optional parts of a sensor type: checked where they are offered, named where they are not."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import pytest

_F = TypeVar("_F", bound=Callable[..., None])


def needs(*capabilities: str) -> Callable[[_F], _F]:
    """Marks a check that asks for optional capabilities (names of `Stage.offers`)."""

    def mark(check: _F) -> _F:
        check.needs = capabilities  # type: ignore[attr-defined]
        return check

    return mark


def report_what_is_not_offered(stage: Any) -> None:
    """Puts `check[not offered: simulate]` in the place of each check that `stage` cannot meet.

    Such a test states that the capability is missing, and fails once it is not.
    """
    offers = stage.offers()
    for name in dir(stage):
        asked = getattr(getattr(stage, name), "needs", ())
        missing = [capability for capability in asked if not offers[capability]]
        if missing:
            setattr(stage, name, _not_offered(missing))


def _not_offered(missing: list[str]) -> Callable[..., None]:
    ids = [f"not offered: {capability}" for capability in missing]

    @pytest.mark.parametrize("capability", missing, ids=ids)
    def check(self: Any, capability: str) -> None:
        assert not self.offers()[capability]

    check.__doc__ = "The sensor type does not offer what this check needs."
    result: Callable[..., None] = check
    return result
