"""rigcal from wheels only, with plugins from outside. `.ci/run` builds the wheels and calls this:

    RIGCAL_WHEELS=DIR uv run pytest tests/wheels

DIR holds the wheels of the five distributions and of the two examples.
"""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml
from scipy.stats import chi2

ROOT = Path(__file__).parents[2]
RADAR = ROOT / "examples" / "rigcal-radar"
WHEELS = Path(os.environ["RIGCAL_WHEELS"])
EXPOSURES, SEED = "20", "5"

BROKEN_PROJECT = """
[build-system]
requires = ["hatchling>=1.27"]
build-backend = "hatchling.build"
[project]
name = "acme-broken"
version = "2.0"
[project.entry-points.rigcal]
broken = "acme_broken"
[tool.hatch.build.targets.wheel]
packages = ["acme_broken.py"]
"""


class Environment:
    """A new environment; calling it runs one of its programs."""

    def __init__(self, folder: Path, *requirements: str) -> None:
        self._folder = folder
        self._variables = {
            k: v for k, v in os.environ.items() if k not in ("VIRTUAL_ENV", "PYTHONPATH")
        }
        self._uv("venv", "--quiet", str(folder))
        self.install(*requirements)

    def install(self, *requirements: str) -> None:
        self._uv("pip", "install", "--quiet", "--python", str(self._folder), *requirements)

    def _uv(self, *arguments: str) -> None:
        subprocess.run(["uv", *arguments], check=True, env=self._variables, cwd=ROOT)

    def __call__(
        self, program: str, *arguments: str | Path, cwd: Path
    ) -> subprocess.CompletedProcess[str]:
        command = [str(self._folder / "bin" / program), *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, env=self._variables, cwd=cwd)


def _wheels(*, with_examples: bool) -> list[str]:
    outside = ("rigcal_radar", "rigcal_minimal")
    return [
        str(path)
        for path in sorted(WHEELS.glob("*.whl"))
        if with_examples or not path.name.startswith(outside)
    ]


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Environment:
    """The five distributions, the two examples, and the kit."""
    (core,) = WHEELS.glob("rigcal-*.whl")
    kit = f"rigcal[testing] @ {core.resolve().as_uri()}"
    folder = tmp_path_factory.mktemp("whole") / "env"
    return Environment(folder, *_wheels(with_examples=True), kit)


@pytest.fixture(scope="session")
def without_radar(tmp_path_factory: pytest.TempPathFactory) -> Environment:
    """The five distributions, and a plugin that raises when it is imported."""
    project = tmp_path_factory.mktemp("broken")
    (project / "pyproject.toml").write_text(BROKEN_PROJECT)
    (project / "acme_broken.py").write_text("raise RuntimeError('no antenna')\n# rigcal_commands\n")
    folder = tmp_path_factory.mktemp("without") / "env"
    return Environment(folder, *_wheels(with_examples=False), str(project))


@pytest.fixture(scope="session")
def calibrated(whole: Environment, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The radar's rig, simulated and calibrated."""
    out = tmp_path_factory.mktemp("radar")
    rig, scenario = RADAR / "rig.yaml", RADAR / "scenario.yaml"
    simulated = ("--scenario", scenario, "--out", out, "--poses", EXPOSURES, "--seed", SEED)
    _succeeds(whole("rigcal", "simulate", rig, *simulated, "--quiet", cwd=out))
    recording = out / "recording.mcap"
    _succeeds(whole("rigcal", "calibrate", rig, recording, "--out", out, "--quiet", cwd=out))
    return out


def _succeeds(done: subprocess.CompletedProcess[str]) -> str:
    assert done.returncode == 0, done.stderr or done.stdout
    return done.stdout


def test_nothing_comes_from_the_working_tree(whole: Environment, tmp_path: Path) -> None:
    names = "rigcal, rigcal_camera, rigcal_lrf2d, rigcal_lrf3d, rigcal_sim, rigcal_radar"
    code = f"import {names}\nfor m in ({names}): print(m.__file__)"
    files = _succeeds(whole("python", "-c", code, cwd=tmp_path)).splitlines()
    assert len(files) == 6
    assert all("site-packages" in file and not file.startswith(str(ROOT)) for file in files)


def test_the_plugins_from_outside_are_listed(whole: Environment, tmp_path: Path) -> None:
    answer = json.loads(_succeeds(whole("rigcal", "plugins", "--json", cwd=tmp_path)))
    offers = {p["distribution"]: (p["version"], p["offers"]) for p in answer["plugins"]}
    assert offers["rigcal-radar"] == ("0.1.0", "sensor type radar")
    assert offers["rigcal-minimal"] == ("0.1.0", "sensor type tracker")
    assert answer["broken"] == []


@pytest.mark.parametrize("example", ["rigcal-radar", "rigcal-minimal"])
def test_their_own_tests_pass(whole: Environment, example: str) -> None:
    folder = ROOT / "examples" / example
    _succeeds(whole("python", "-m", "pytest", "-q", "-p", "no:cacheprovider", cwd=folder))


def test_a_new_plugin_passes_its_tests_as_written(whole: Environment, tmp_path: Path) -> None:
    _succeeds(whole("rigcal", "new-plugin", "sonar", cwd=tmp_path))
    project = tmp_path / "rigcal-sonar"
    whole.install(f"{project}[test]")
    _succeeds(whole("python", "-m", "pytest", "-q", cwd=project))
    assert "sensor type sonar" in _succeeds(whole("rigcal", "plugins", "--json", cwd=tmp_path))


def test_the_radar_is_found_and_its_covariance_is_true(
    whole: Environment, calibrated: Path
) -> None:
    truth = calibrated / "truth.yaml"
    arguments = ("evaluate", calibrated / "calibration.yaml", "--truth", truth, "--json")
    answer: dict[str, Any] = json.loads(_succeeds(whole("rigcal", *arguments, cwd=calibrated)))
    radar = answer["sensors"]["radar"]
    low, high = chi2.interval(0.997, 6)
    assert low < radar["nees"] < high


def test_without_it_a_rig_that_names_it_is_told_what_there_is(
    without_radar: Environment, calibrated: Path
) -> None:
    data = calibrated / "observations.npz"
    arguments = ("calibrate", RADAR / "rig.yaml", data, "--out", calibrated / "none")
    done = without_radar("rigcal", *arguments, cwd=calibrated)
    assert done.returncode == 2
    assert "sensors.radar.type: no sensor type 'radar'" in done.stderr
    assert "installed: camera, lrf2d, lrf3d" in done.stderr
    assert "a broken plugin may have offered it: acme-broken" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_nearest_type_is_named(without_radar: Environment, tmp_path: Path) -> None:
    text = (RADAR / "rig.yaml").read_text().replace("type: radar", "type: camra")
    (tmp_path / "rig.yaml").write_text(text)
    arguments = ("simulate", "rig.yaml", "--out", tmp_path / "out")
    done = without_radar("rigcal", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert "no sensor type 'camra', did you mean 'camera'?" in done.stderr


def test_a_broken_plugin_beside_them_is_named_and_harmless(
    without_radar: Environment, tmp_path: Path
) -> None:
    listed = _succeeds(without_radar("rigcal", "plugins", cwd=tmp_path))
    assert "broken: plugin 'broken' of acme-broken 2.0 is left out" in listed
    assert "RuntimeError: no antenna; mend it or remove it: pip uninstall acme-broken" in listed
    rig = yaml.safe_load((RADAR / "rig.yaml").read_text())
    del rig["sensors"]["radar"]
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(rig))
    scenario = ("--scenario", RADAR / "scenario.yaml", "--poses", "8")
    for arguments in (
        ("simulate", "rig.yaml", *scenario, "--out", "out", "--quiet"),
        ("calibrate", "rig.yaml", "out/recording.mcap", "--out", "out", "--quiet"),
        ("evaluate", "out/calibration.yaml", "--truth", "out/truth.yaml"),
    ):
        done = without_radar("rigcal", *arguments, cwd=tmp_path)
        assert (done.returncode, done.stderr) == (0, "")
