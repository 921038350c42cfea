"""rigcal inside somebody else's program: it can be stopped, shared by threads, and is silent."""

from __future__ import annotations

import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

import rigcal
from rigcal.calibration_text import calibration_text


class _Stopper:
    """A progress callback that stops the work at the n-th call."""

    def __init__(self, after: int) -> None:
        self.calls: list[tuple[str, int, int]] = []
        self._after = after

    def __call__(self, description: str, done: int, total: int) -> None:
        self.calls.append((description, done, total))
        if len(self.calls) >= self._after:
            raise rigcal.Cancelled(f"stopped: {description} {done}/{total}")


@pytest.mark.parametrize("after", [1, 2])
def test_detection_can_be_stopped(
    rig: rigcal.Rig, registry: Any, recording: Path, after: int
) -> None:
    before = sorted(recording.parent.iterdir())
    stop = _Stopper(after)
    with pytest.raises(rigcal.Cancelled, match="stopped: detecting the target"):
        rigcal.detect(rig, registry, recording, stop, jobs=1)
    assert len(stop.calls) == after
    assert sorted(recording.parent.iterdir()) == before


def test_work_goes_on_in_the_same_processes_after_a_stop(
    rig: rigcal.Rig, registry: Any, recording: Path, observations: Any
) -> None:
    """Two threads share them; one of them stops."""

    def stopped(_: object) -> None:
        with pytest.raises(rigcal.Cancelled):
            rigcal.detect(rig, registry, recording, _Stopper(2), jobs=2)

    with ThreadPoolExecutor(1) as pool:
        stop = pool.submit(stopped, None)
        seen = rigcal.detect(rig, registry, recording, jobs=2)
        stop.result()
    assert [(o.sensor, o.exposure) for o in seen] == [(o.sensor, o.exposure) for o in observations]


def test_simulation_can_be_stopped(rig: rigcal.Rig, registry: Any, tmp_path: Path) -> None:
    from rigcal_sim import simulate

    with pytest.raises(rigcal.Cancelled):
        simulate(rig, registry, None, 1, tmp_path, ("mcap", "bag"), _Stopper(2), poses=10, jobs=2)
    assert list(tmp_path.iterdir()) == []


def test_calibration_can_be_stopped(
    rig: rigcal.Rig, registry: Any, observations: Any, alone: str
) -> None:
    counting = _Stopper(10**9)
    rigcal.calibrate(rig, registry, observations, 3, counting)
    for after in (1, len(counting.calls) // 2, len(counting.calls)):
        with pytest.raises(rigcal.Cancelled):
            rigcal.calibrate(rig, registry, observations, 3, _Stopper(after))
    assert calibration_text(rigcal.calibrate(rig, registry, observations, 3)) == alone


@pytest.fixture(scope="module")
def observations(rig: rigcal.Rig, registry: Any, recording: Path) -> Any:
    return rigcal.detect(rig, registry, recording, jobs=1)


@pytest.fixture(scope="module")
def alone(rig: rigcal.Rig, registry: Any, observations: Any) -> str:
    """The result of a calibration that has the program for itself."""
    return calibration_text(rigcal.calibrate(rig, registry, observations, 3))


def test_threads_get_what_they_get_alone(
    rig: rigcal.Rig, registry: Any, recording: Path, alone: str, tmp_path: Path
) -> None:
    start = threading.Barrier(2)

    def run(number: int) -> str:
        start.wait()
        seen = rigcal.detect(rig, registry, recording, jobs=1)
        calibration = rigcal.calibrate(rig, registry, seen, 3)
        rigcal.write_report(tmp_path / f"{number}.html", calibration, seen, rig, registry)
        return calibration_text(calibration)

    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(run, range(2))) == [alone, alone]
    reports = [(tmp_path / f"{number}.html").read_bytes() for number in range(2)]
    assert reports[0] == reports[1]


def test_nothing_is_printed_and_the_folder_stays(
    rig: rigcal.Rig,
    registry: Any,
    recording: Path,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    seen = rigcal.detect(rig, registry, recording, jobs=2)
    calibration = rigcal.calibrate(rig, registry, seen)
    rigcal.write_report(tmp_path / "out" / "report.html", calibration, seen, rig, registry)
    rigcal.write_export(tmp_path / "out" / "poses.txt", calibration, registry, "matrices")
    output = capfd.readouterr()
    assert (output.out, output.err) == ("", "")
    assert Path.cwd() == tmp_path
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


PROGRAM = """
import os, sys
for stream in (0, 1, 2):
    os.close(stream)
sys.stdin = sys.stdout = sys.stderr = None
import rigcal

rig_file, recording, out = sys.argv[1:]
registry = rigcal.Registry.from_entry_points()
rig = rigcal.load_rig(rig_file, registry)
seen = rigcal.detect(rig, registry, recording, jobs=2)
calibration = rigcal.calibrate(rig, registry, seen, seed=3)
rigcal.save_calibration(out + "/calibration.yaml", calibration)
"""


def test_works_without_standard_streams(
    recording: Path, alone: str, tmp_path: Path, rig_text: str
) -> None:
    (tmp_path / "rig.yaml").write_text(rig_text)
    arguments = [str(tmp_path / "rig.yaml"), str(recording), str(tmp_path)]
    done = subprocess.run([sys.executable, "-c", PROGRAM, *arguments])
    assert done.returncode == 0
    assert (tmp_path / "calibration.yaml").read_text() == alone
