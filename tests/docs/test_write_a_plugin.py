"""The plugin that docs/guide/write-a-plugin.md shows whole."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("file", ["src/rigcal_tracker.py", "tests/test_tracker.py"])
def test_it_is_the_smallest_example(desk: Any, page: Any, file: str) -> None:
    desk.write(page("guide/write-a-plugin.md"))
    shown = desk.folder / "rigcal-tracker" / file
    assert shown.read_text() == (ROOT / "examples" / "rigcal-minimal" / file).read_text()


def test_it_is_listed_and_passes_the_kit_by_its_own_settings(
    desk: Any, page: Any, own_tests: Any
) -> None:
    desk.follow(page("guide/write-a-plugin.md"))
    assert "tracker" in desk.printed
    folder = desk.folder / "rigcal-tracker"
    done = own_tests(folder)
    assert done.returncode == 0, done.stdout
    assert "passed, 1 deselected" in done.stdout
