"""The time line for rerun, checked by rerun's own program."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from rigcal import Registry, calibrate, calibration_of_poses, detect, load_rig, write_timeline
from rigcal.observation import Observation

RIG = Path(__file__).parents[1] / "integration" / "pipeline" / "cart.yaml"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory, command: Any) -> Path:
    folder = tmp_path_factory.mktemp("recorded")
    options = ("--poses", 15, "--seed", 2, "-q")
    assert command("simulate", RIG, "--out", folder, *options).code == 0
    return folder / "recording.mcap"


@pytest.fixture(scope="module")
def found(recorded: Path) -> tuple[Any, Any, tuple[Observation, ...], Any]:
    registry = Registry.from_entry_points()
    rig = load_rig(RIG, registry)
    observations = tuple(detect(rig, registry, recorded))
    return rig, registry, observations, calibrate(rig, registry, observations)


def entities(path: Path) -> Counter[str]:
    """Rows by entity, as rerun reads them; the file is whole."""
    program = shutil.which("rerun")
    assert program, "install rerun-sdk (rigcal[view])"
    subprocess.run([program, "rrd", "verify", path], check=True, capture_output=True)
    done = subprocess.run(
        [program, "rrd", "print", path], check=True, capture_output=True, text=True
    )
    rows: Counter[str] = Counter()
    for count, entity in re.findall(r"with (\d+) rows .*? - (/\S.*?) - ", done.stdout):
        rows[entity.replace("\\", "")] += int(count)
    return rows


def test_frames_boards_and_sensors_are_on_the_line(tmp_path, recorded, found):
    rig, registry, observations, calibration = found
    path = tmp_path / "line.rrd"
    write_timeline(path, calibration, observations, rig, registry, recorded)
    rows = entities(path)
    exposures = {o.exposure for o in observations if o.candidates}
    assert rows["/exposures"] == len(exposures)
    for sensor in rig.sensors:
        assert rows[f"/rig/after/{sensor}"] == 1
    assert rows["/rig/after/lidar/points"] == len(exposures)
    assert rows["/rig/after/scan/points"] == len(exposures)
    assert rows["/images/left"] == len(exposures)
    assert rows["/images/left/after/lidar"] == len(exposures)
    assert 0 < rows["/images/left/after/board"] <= len(exposures)
    assert not any("before" in entity for entity in rows)


def test_before_and_after_stand_side_by_side(tmp_path, recorded, found):
    rig, registry, observations, calibration = found
    path = tmp_path / "line.rrd"
    before = calibration_of_poses(rig)
    write_timeline(path, calibration, observations, rig, registry, recorded, before)
    rows = entities(path)
    assert rows["/rig/before/lidar/points"] == rows["/rig/after/lidar/points"] > 0
    assert rows["/images/left/before/lidar"] == rows["/images/left/after/lidar"] > 0
    assert rows["/rig/before/boards"] == 0, "poses alone say nothing of boards"


def test_a_tree_that_hangs_from_another_root_is_put_in_place(tmp_path, recorded, found):
    """And a sensor that the calibration does not have is left out."""
    rig, registry, observations, calibration = found
    path = tmp_path / "line.rrd"
    before = calibration_of_poses(replace(rig, root="left"))
    few = {name: s for name, s in calibration.sensors.items() if name != "scan"}
    part = replace(calibration, sensors=few)
    write_timeline(path, part, observations, rig, registry, recorded, before)
    rows = entities(path)
    assert rows["/rig/before"] == 1
    assert rows["/rig/after/lidar/points"] > 0
    assert rows["/rig/after/scan/points"] == 0


def test_without_a_recording_the_rig_and_its_boards_are_shown(tmp_path, found):
    rig, registry, observations, calibration = found
    path = tmp_path / "line.rrd"
    write_timeline(path, calibration, observations, rig, registry)
    rows = entities(path)
    assert rows["/rig/after/boards"] == 1
    assert not any(entity.startswith("/images") for entity in rows)
