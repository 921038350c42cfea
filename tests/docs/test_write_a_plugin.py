"""The plugin that docs/guide/write-a-plugin.md shows whole."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("file", ["src/rigcal_tracker.py", "tests/test_tracker.py"])
def test_it_is_the_smallest_example(desk: Any, page: Any, file: str) -> None:
    desk.write(page("guide/write-a-plugin.md"))
    shown = desk.folder / "rigcal-tracker" / file
    assert shown.read_text() == (ROOT / "examples" / "rigcal-minimal" / file).read_text()


def test_it_is_listed_and_passes_the_kit_by_its_own_settings(desk: Any, page: Any) -> None:
    desk.follow(page("guide/write-a-plugin.md"))
    assert "tracker" in desk.printed
    # The chi-square test over many rigs takes most of the time; it runs in tests/wheels.
    arguments = ["-q", "-p", "no:cacheprovider", "-k", "not covariance_is_true"]
    folder = desk.folder / "rigcal-tracker"
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(folder / "src")},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout
    assert "passed, 1 deselected" in done.stdout
