"""A calibration for other programs: what they read is what it says."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rigcal
from rigcal.calibration import Calibration, SensorResult
from rigcal.errors import InputError, PluginError
from rigcal.geometry import se3
from rigcal.plugin import Exporter, Registry, SensorConfig, hookimpl
from rigcal.rig import Rig

T_LIDAR_CAM = se3.exp(np.array([0.3, -1.1, 0.7, 0.2, -0.4, 0.6]))
T_CAM_FRONT = se3.exp(np.array([-0.9, 0.2, 1.5, 1.2, 0.1, -0.3]))
COVARIANCE = np.diag([1e-8, 2e-8, 3e-8, 1e-6, 2e-6, 3e-6])
CALIBRATION = Calibration(
    "lidar",
    {
        "lidar": SensorResult("lidar", np.eye(4)),
        "cam": SensorResult("lidar", T_LIDAR_CAM, COVARIANCE),
        "front": SensorResult("cam", T_CAM_FRONT, COVARIANCE),
    },
)
POSES = {"lidar": np.eye(4), "cam": T_LIDAR_CAM, "front": T_LIDAR_CAM @ T_CAM_FRONT}


def _registry(text: Callable[..., Any], *, needs_rig: bool = False) -> Registry:
    def rigcal_exporters() -> list[Exporter]:
        return [Exporter("acme", "for a test", text, needs_rig)]

    return Registry([SimpleNamespace(rigcal_exporters=hookimpl(rigcal_exporters))])


def test_json_has_every_pose_in_the_root() -> None:
    text = rigcal.export(CALIBRATION, Registry(), "json")
    assert isinstance(text, str)
    content = json.loads(text)
    assert content["root"] == "lidar"
    assert "p_lidar = matrix @ [p_sensor, 1]" in content["convention"]
    for name, T in POSES.items():
        sensor = content["sensors"][name]
        np.testing.assert_allclose(sensor["matrix"], T, atol=1e-12)
        R = se3.rotation_from_quaternion(np.array(sensor["quaternion_xyzw"]))
        np.testing.assert_allclose(R, T[:3, :3], atol=1e-12)
        assert sensor["translation_m"] == T[:3, 3].tolist()
    assert content["sensors"]["front"]["covariance"] == COVARIANCE.tolist()
    assert content["sensors"]["front"]["covariance_parent"] == "cam"


def test_matrices_are_read_by_numpy_in_the_order_of_their_names() -> None:
    text = rigcal.export(CALIBRATION, Registry(), "matrices")
    assert isinstance(text, str)
    matrices = np.loadtxt(io.StringIO(text)).reshape(-1, 4, 4)
    np.testing.assert_array_equal(matrices, list(POSES.values()))
    names = [line.split()[1] for line in text.splitlines() if line.startswith("# T_")]
    assert names == ["T_lidar_lidar", "T_lidar_cam", "T_lidar_front"]


def test_exporter_with_several_files_fills_a_folder(tmp_path: Path) -> None:
    registry = _registry(lambda calibration, rig: {f"{s}.txt": s for s in calibration.sensors})
    paths = rigcal.write_export(tmp_path / "out", CALIBRATION, registry, "acme")
    assert [p.name for p in paths] == ["lidar.txt", "cam.txt", "front.txt"]
    assert {p.name: p.read_text() for p in (tmp_path / "out").iterdir()} == {
        "lidar.txt": "lidar", "cam.txt": "cam", "front.txt": "front",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (None, "exporter 'acme' answered nothing, expected text"),
        ({"../a.txt": "a"}, "answered the file '../a.txt', expected text by file name"),
        ({"a.txt": 3}, "answered the file 'a.txt', expected text"),
    ],
)
def test_nonsense_of_an_exporter_is_named(answer: object, message: str) -> None:
    with pytest.raises(PluginError) as caught:
        rigcal.export(CALIBRATION, _registry(lambda calibration, rig: answer), "acme")
    assert message in str(caught.value)


def test_exporter_that_fails_is_named_and_nothing_is_written(tmp_path: Path) -> None:
    registry = _registry(lambda calibration, rig: 1 / 0)
    with pytest.raises(PluginError, match="exporter 'acme' failed with ZeroDivisionError"):
        rigcal.write_export(tmp_path / "out.txt", CALIBRATION, registry, "acme")
    assert list(tmp_path.iterdir()) == []


def test_exporter_that_needs_the_rig_says_so_without_one() -> None:
    registry = _registry(lambda calibration, rig: rig.name, needs_rig=True)
    with pytest.raises(InputError, match="give the rig too"):
        rigcal.export(CALIBRATION, registry, "acme")


def test_rig_of_other_sensors_is_refused() -> None:
    sensors = {"lidar": SensorConfig(type="lrf3d", topic="/points")}
    rig = Rig("cart", "lidar", {}, sensors)
    with pytest.raises(InputError, match=r"the calibration has .*which the rig does not"):
        rigcal.export(CALIBRATION, _registry(lambda calibration, rig: ""), "acme", rig)


def test_command_writes_the_file_and_tells_programs(tmp_path: Path, command: Any) -> None:
    source, out = tmp_path / "calibration.yaml", tmp_path / "poses.txt"
    rigcal.save_calibration(source, CALIBRATION)
    run = partial(command, "export", source, "--out", out)
    code, text, _ = run("--format", "matrices", "--json")
    assert (code, json.loads(text)) == (0, {"format": "matrices", "files": [str(out)]})
    np.testing.assert_allclose(np.loadtxt(out).reshape(-1, 4, 4), list(POSES.values()), atol=1e-15)
    code, text, _ = run("--format", "json")
    assert (code, text) == (0, f"{out}: JSON: every sensor's pose in the root, with covariance\n")
    assert run("--format", "json", "--quiet") == (0, "", "")
    code, text, error = run("--format", "jason")
    assert (code, text) == (2, "")
    assert "no exporter 'jason', did you mean 'json'?" in error
