"""The time line for rerun, checked by rerun's own program."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import rerun

from rigcal import Registry, calibrate, calibration_of_poses, detect, load_rig
from rigcal.observation import Observation
from rigcal.plugin import hookimpl
from rigcal.report import show_timeline, write_timeline

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


def printed(path: Path, *options: str) -> str:
    """What rerun tells of a file."""
    done = subprocess.run(
        ["rerun", "rrd", "print", *options, path], check=True, capture_output=True, text=True
    )
    return done.stdout


def entities(path: Path) -> Counter[str]:
    """Rows by entity, as rerun reads them; the file is whole."""
    program = shutil.which("rerun")
    assert program, "install rerun-sdk (rigcal[view])"
    subprocess.run([program, "rrd", "verify", path], check=True, capture_output=True)
    rows: Counter[str] = Counter()
    for count, entity in re.findall(r"with (\d+) rows .*? - (/\S.*?) - ", printed(path)):
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
    assert "index_name: time" in printed(path, "-vv")


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


def test_what_one_of_two_calibrations_does_not_know_is_drawn_for_the_other(
    tmp_path, recorded, found
):
    """Frames that bear no stamp stand on the line of exposures alone."""
    rig, registry, observations, calibration = found
    path = tmp_path / "line.rrd"
    few = {name: s for name, s in calibration.sensors.items() if name in ("lidar", "right")}
    before = replace(calibration, sensors=few, target_poses={})
    extra = {**calibration.sensors, "imu": calibration.sensors["left"]}
    seen = [replace(o, stamp_ns=0) for o in observations]
    whole = replace(calibration, sensors=extra)
    write_timeline(path, whole, seen, rig, registry, recorded, before)
    rows = entities(path)
    count = rows["/images/left"]
    assert rows["/rig/after/scan/points"] == rows["/images/right/after/scan"] == count
    assert rows["/images/right/before/lidar"] == rows["/images/left/after/lidar"] == count
    for unknown in ("/rig/before/scan/points", "/images/left/before/lidar"):
        assert rows[unknown] == 0, unknown
    assert rows["/images/right/before/scan"] == rows["/images/right/before/board"] == 0
    assert rows["/rig/after/imu"] == 1
    assert rows["/rig/after/imu/view"] == 0, "the rig file does not say what it sees"
    assert "index_name: exposure" in printed(path, "-vv")
    assert "index_name: time" not in printed(path, "-vv")


def test_types_that_neither_project_nor_say_what_they_see(tmp_path, recorded, found):
    """There are pictures of such a camera, with nothing over them, and no view of such a laser."""
    rig, registry, observations, calibration = found
    kinds = [
        replace(registry.sensor_type("camera"), project=None, sees=None),
        registry.sensor_type("lrf2d"),
        replace(registry.sensor_type("lrf3d"), sees=None),
    ]
    silent = Registry([SimpleNamespace(rigcal_sensor_types=hookimpl(lambda: kinds))])
    path = tmp_path / "line.rrd"
    write_timeline(path, calibration, observations, rig, silent, recorded)
    rows = entities(path)
    assert rows["/images/left"] > 0
    assert rows["/rig/after/scan/view"] == 1
    assert rows["/rig/after/lidar/view"] == rows["/rig/after/left/view"] == 0


def test_the_window_shows_what_the_file_holds(tmp_path, found, monkeypatch):
    rig, registry, observations, calibration = found
    path, shown = tmp_path / "line.rrd", tmp_path / "shown.rrd"
    write_timeline(path, calibration, observations, rig, registry)
    monkeypatch.setattr(rerun.RecordingStream, "spawn", lambda stream: stream.save(shown))
    show_timeline(calibration, observations, rig, registry)
    drawn = [
        {entity: n for entity, n in entities(file).items() if entity.startswith(("/rig", "/exp"))}
        for file in (path, shown)
    ]
    assert drawn[0] == drawn[1] != {}


def test_the_command(tmp_path, recorded, command, monkeypatch):
    folder, line = tmp_path / "found", tmp_path / "line.rrd"
    assert command("calibrate", RIG, recorded, "--out", folder, "-q").code == 0
    asked = ("view", recorded, folder / "calibration.yaml", "--rig", RIG)
    done = command(*asked, "--save", line, "--before", RIG)
    assert done.code == 0
    assert done.out == f"time line  {line}  (look at it with: rerun {line})\n"
    assert {"/rig/after/lidar/points", "/rig/before/lidar/points"} <= set(entities(line))
    shown = tmp_path / "shown.rrd"
    monkeypatch.setattr(rerun.RecordingStream, "spawn", lambda stream: stream.save(shown))
    opened = command(*asked, "-q")
    assert (opened.code, opened.out, opened.err) == (0, "", "")
    assert "/rig/after/lidar/points" in entities(shown)
    (folder / "observations.npz").rename(tmp_path / "elsewhere.npz")
    missing = command(*asked, "--save", tmp_path / "none.rrd")
    assert missing.code == 2
    assert f"{folder / 'observations.npz'}: no such file; give the observations" in missing.err
    quiet = command(*asked, "--save", line, "--observations", tmp_path / "elsewhere.npz", "-q")
    assert (quiet.code, quiet.out, quiet.err) == (0, "", "")


def test_the_command_of_the_guide(tmp_path, recorded, command, monkeypatch):
    """In a folder that has what the page has."""
    page = Path(__file__).parents[2] / "docs" / "guide" / "read-the-result.md"
    (line,) = re.findall(r"^rigcal (view .*)$", page.read_text(), flags=re.M)
    (tmp_path / "recording.mcap").symlink_to(recorded)
    (tmp_path / "rig.yaml").symlink_to(RIG)
    assert command("calibrate", RIG, recorded, "--out", tmp_path / "first", "-q").code == 0
    monkeypatch.chdir(tmp_path)
    shown = tmp_path / "shown.rrd"
    monkeypatch.setattr(rerun.RecordingStream, "spawn", lambda stream: stream.save(shown))
    assert command(*line.split()).code == 0
    assert {"/rig/after/lidar/points", "/rig/before/lidar/points"} <= set(entities(shown))


def test_without_a_recording_the_rig_and_its_boards_are_shown(tmp_path, found):
    rig, registry, observations, calibration = found
    path = tmp_path / "line.rrd"
    write_timeline(path, calibration, observations, rig, registry)
    rows = entities(path)
    assert rows["/rig/after/boards"] == 1
    assert not any(entity.startswith("/images") for entity in rows)
