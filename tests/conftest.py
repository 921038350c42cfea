"""Settings of all tests, and what tests of different rooms measure in the same way."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

# One thread each, before numpy starts its own: tests share the cores, and matrices are small.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402
import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402

# A test asserts behaviour, not time; and the same code gets the same answer on every run.
settings.register_profile("rigcal", deadline=None, derandomize=True)
settings.load_profile("rigcal")


class Ran(NamedTuple):
    """What became of a command: its exit status, and what it printed."""

    code: int
    out: str
    err: str


@pytest.fixture(scope="session")
def command() -> Callable[..., Ran]:
    """The command line, as users have it but for the process."""
    from rigcal.cli import main

    def run(*arguments: object) -> Ran:
        out, err = StringIO(), StringIO()
        with redirect_stdout(out), redirect_stderr(err), pytest.raises(SystemExit) as ended:
            main([str(argument) for argument in arguments])
        return Ran(int(ended.value.code or 0), out.getvalue(), err.getvalue())

    return run


@pytest.fixture
def own_tests() -> Callable[[Path], subprocess.CompletedProcess[str]]:
    """`own_tests(folder)`: a plugin's tests by its own settings, as its author runs them.

    But for the chi-square test over many rigs, which takes long and runs in tests/wheels.
    """

    def run(folder: Path) -> subprocess.CompletedProcess[str]:
        arguments = ["-q", "-p", "no:cacheprovider", "-k", "not covariance_is_true"]
        return subprocess.run(
            [sys.executable, "-m", "pytest", *arguments],
            cwd=folder,
            env=os.environ | {"PYTHONPATH": str(folder / "src")},
            capture_output=True,
            text=True,
        )

    return run


class PrintedPage:
    """A rendered target page as a user with a scanner would measure it: no layout is assumed.

    `image` (H, W) is grey; the page's lower left corner is that of the image.
    """

    def __init__(self, image: Any, px_per_mm: float) -> None:
        self.image = np.ascontiguousarray(image)
        self.px_per_mm = px_per_mm

    def mm(self, uv: Any) -> Any:
        """Pixels (..., 2), (0, 0) the centre of the first, to mm from the lower left corner."""
        return np.stack(
            [uv[..., 0] + 0.5, self.image.shape[0] - 0.5 - uv[..., 1]], axis=-1
        ) / self.px_per_mm  # fmt: skip

    def tags_mm(self, family: str = "tag36h11") -> dict[int, Any]:
        """(4, 2) corners in mm of every AprilTag, in the order of a target's `tag_corners`."""
        import pyapriltags

        found = pyapriltags.Detector(families=family, quad_decimate=1.0).detect(self.image)
        return {tag.tag_id: self.mm(tag.corners - 0.5) for tag in found}

    def ruler_mm(self) -> Any:
        """Positions in mm of the ticks of the lowest long stroke, as centroids of their ink."""
        import cv2

        ink = 1 - self.image / 255.0
        stroke = np.ones((1, round(95 * self.px_per_mm)), dtype=np.uint8)
        long = cv2.erode((ink > 0.3).astype(np.uint8), stroke).any(axis=1)
        row = np.flatnonzero(long).max() - round(1.0 * self.px_per_mm)
        line = ink[row]
        dark = np.flatnonzero(np.diff(np.concatenate([[0], line > 0.05, [0]])))
        runs = [np.arange(a, b) for a, b in dark.reshape(-1, 2)]
        return (np.array([np.average(run, weights=line[run]) for run in runs]) + 0.5) / (
            self.px_per_mm
        )


@pytest.fixture(scope="session")
def printed_page() -> Any:
    return PrintedPage


@pytest.fixture(scope="session")
def definition_in() -> Any:
    """The definition of a target within the text of a page, parsed."""
    import yaml

    def parse(text: str, name: str) -> Any:
        match = re.search(rf"^\s*{name}: \{{.*\}}", text, flags=re.MULTILINE | re.DOTALL)
        assert match, text
        return yaml.safe_load(match[0])[name]

    return parse


@pytest.fixture(scope="session")
def lay_out() -> Callable[[Path], Path]:
    """What `pip install --editable` does to a project, but for its dependencies.

    Returns the folder that must be on the path.
    """

    def run(project: Path) -> Path:
        about = tomllib.loads((project / "pyproject.toml").read_text())["project"]
        source = project / "src"
        info = source / f"{about['name'].replace('-', '_')}-{about['version']}.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {about['name']}\nVersion: {about['version']}\n"
        )
        entries = about["entry-points"]["rigcal"].items()
        lines = "".join(f"{name} = {module}\n" for name, module in entries)
        (info / "entry_points.txt").write_text(f"[rigcal]\n{lines}")
        return source

    return run
