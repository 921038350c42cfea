"""The message nearest in time, without reading all of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Self

import pytest

from rigcal.errors import RecordingError
from rigcal.recording import Message, Source, nearest_message, open_recording

STAMPS = [0, 100, 101, 230, 1000, 1010, 1020, 5000]


class Untimed:
    """A recording of a plugin's that does not know when its messages were recorded."""

    def __init__(self, stamps: list[int]) -> None:
        self.stamps, self.reads = stamps, 0

    def count(self, source: Source) -> int:
        return len(self.stamps)

    def read(self, source: Source, first: int = 0, stop: int | None = None) -> Iterator[Message]:
        for stamp in self.stamps[first:stop]:
            self.reads += 1
            yield Message(".x", None, stamp, None, "")

    def contents(self) -> Mapping[str, tuple[str, int]]:
        return {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None: ...


class Timed(Untimed):
    """Its messages are recorded well after their stamps."""

    def times_ns(self, source: Source) -> list[int]:
        return [stamp + 300 for stamp in self.stamps]


@pytest.mark.parametrize("kind", [Untimed, Timed])
@pytest.mark.parametrize("wanted", [-5, 0, 40, 100, 102, 160, 170, 620, 1009, 1012, 3100, 9000])
def test_of_uneven_stamps_it_is_the_nearest(kind: type[Untimed], wanted: int) -> None:
    found = nearest_message(kind(STAMPS), Source("/x"), wanted)
    assert abs(found.stamp_ns - wanted) == min(abs(stamp - wanted) for stamp in STAMPS)


@pytest.mark.parametrize("kind", [Untimed, Timed])
def test_few_messages_are_read(kind: type[Untimed]) -> None:
    recording = kind(list(range(0, 10_000_000, 1000)))
    assert nearest_message(recording, Source("/x"), 7_654_321).stamp_ns == 7_654_000
    assert recording.reads < 25


def test_in_every_kind_of_bag(bag: Path) -> None:
    source = Source("/front/scan")
    with open_recording(bag) as recording:
        stamps = [m.stamp_ns for m in recording.read(source)]
        for wanted in (stamps[0] - 10**9, stamps[3], stamps[4] + 10**7, stamps[-1] + 10**9):
            best = min(abs(stamp - wanted) for stamp in stamps)
            assert abs(nearest_message(recording, source, wanted).stamp_ns - wanted) == best
        with pytest.raises(RecordingError, match="'/frnt' is not in the recording"):
            nearest_message(recording, Source("/frnt"), 0)


@pytest.mark.parametrize("kind", [Untimed, Timed])
def test_of_a_source_without_messages_there_is_none(kind: type[Untimed]) -> None:
    assert nearest_message(kind([]), Source("/x"), 7) is None
