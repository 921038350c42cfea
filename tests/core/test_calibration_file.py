"""calibration.yaml: what goes in comes out, and nothing half-written is left behind."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from rigcal.calibration import Calibration, GraphError, Rejection, ResidualStatistics, SensorResult
from rigcal.calibration_file import load_calibration, save_calibration
from rigcal.calibration_text import calibration_text
from rigcal.errors import ConfigError, InputError
from rigcal.geometry import se3


def _calibration() -> Calibration:
    rng = np.random.default_rng(5)
    A = rng.normal(size=(6, 6)) * 1e-3
    return Calibration(
        root="lidar",
        sensors={
            "lidar": SensorResult("lidar", np.eye(4), None, 40, 40),
            "cam0": SensorResult(
                "lidar", se3.exp(rng.normal(size=6)), A @ A.T, 40, 39,
                ResidualStatistics("px", 0.21, 3744), 1.02,
            ),
            "cam1": SensorResult("cam0", se3.exp(rng.normal(size=6) * 1e-7)),
        },
        target_poses={"7": se3.exp(rng.normal(size=6))},
        rejected=(Rejection("cam0", "3", "/cam0, message 3", "no tag: too dark"),),
        warnings=("cam1: few exposures",),
        provenance={"seed": np.int64(3), "inputs": {"rig": {"sha256": "00e1"}}, "by": ("a", 2)},
        graph_error=GraphError(0.0123, 0.0101, 340),
    )  # fmt: skip


def test_round_trip(tmp_path: Path) -> None:
    before = _calibration()
    save_calibration(tmp_path / "calibration.yaml", before)
    after = load_calibration(tmp_path / "calibration.yaml")
    assert (after.root, list(after.sensors)) == (before.root, list(before.sensors))
    for name, result in before.sensors.items():
        other = after.sensors[name]
        np.testing.assert_allclose(other.T_parent_sensor, result.T_parent_sensor, atol=1e-15)
        assert (other.parent, other.residual) == (result.parent, result.residual)
        assert (other.observations, other.inliers) == (result.observations, result.inliers)
    np.testing.assert_array_equal(
        after.sensors["cam0"].covariance, before.sensors["cam0"].covariance
    )
    np.testing.assert_allclose(after.target_poses["7"], before.target_poses["7"], atol=1e-15)
    assert (after.rejected, after.warnings) == (before.rejected, before.warnings)
    assert after.graph_error == before.graph_error
    assert after.provenance == {
        "seed": 3, "inputs": {"rig": {"sha256": "00e1"}}, "by": ["a", 2],
    }  # fmt: skip
    np.testing.assert_allclose(after.T("lidar", "cam1"), before.T("lidar", "cam1"), atol=1e-15)


def test_file_says_its_convention_and_keeps_matrix_rows_on_a_line() -> None:
    text = calibration_text(_calibration())
    entry = yaml.safe_load(text)
    assert entry["format"] == "rigcal-calibration"
    assert entry["convention"].startswith("T_parent_sensor: p_parent = R p_sensor + t")
    assert len(entry["sensors"]["cam0"]["covariance"]) == 6
    assert "    residual: {unit: px, rms: 0.21, count: 3744}\n" in text
    assert text.count("\n    - [") == 6


def test_same_calibration_gives_the_same_bytes() -> None:
    assert calibration_text(_calibration()) == calibration_text(_calibration())


TRUTH = """\
format: rigcal-calibration
version: 1
root: a
sensors:
  b:
    parent: a
    translation_m: {x: 1, y: 0, z: 0}
    rotation: {x: 0, y: 0, z: 0, w: 1}
  c:
    parent: b
    translation_m: {x: 0, y: 2, z: 0}
    rotation: {x: 0, y: 0, z: 0, w: 1}
"""


def test_hand_written_tree_without_its_root(tmp_path: Path) -> None:
    (tmp_path / "truth.yaml").write_text(TRUTH)
    truth = load_calibration(tmp_path / "truth.yaml")
    np.testing.assert_allclose(truth.T("a", "c")[:3, 3], [1, 2, 0])
    assert truth.sensors["b"].covariance is None


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("format: rigcal-calibration", "format: kalibr", ":1: format: found 'kalibr', expected"),
        ("version: 1", "version: 2", ":2: version: found 2, expected 1"),
        ("parent: b", "parent: d", ":10: sensors.c.parent: no sensor 'd'"),
        ("parent: a", "parent: c", ":6: sensors.b.parent: its parents do not lead to the root 'a'"),
        ("w: 1}\n  c", "w: 2}\n  c", ":8: sensors.b.rotation: the quaternion has length 2, expect"),
        ("x: 1, y: 0, z: 0}", "x: 1, y: 0}", ":7: sensors.b.translation_m: key 'z' is missing"),
        ("x: 1,", "x: .nan,", ":7: sensors.b.translation_m.x: found nan, expected"),
        ("{x: 1, y: 0, z: 0}", "[1, 0, 0]", ":7: sensors.b.translation_m: found a list of 3, expe"),
        ("root: a", "root: c", ":9: sensors.c: 'c' is the root: its parent must be 'c', its pose"),
        ("  b:\n", "  b:\n    covarianc: 1\n", ": unknown key, did you mean 'covariance'?"),
        ("  b:\n", "  b:\n    covariance: [[1]]\n", ":6: sensors.b.covariance"),
    ],
)
def test_wrong_file_is_refused_with_its_line(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    path = tmp_path / "truth.yaml"
    path.write_text(TRUTH.replace(old, new, 1))
    with pytest.raises(ConfigError) as caught:
        load_calibration(path)
    assert f"{path}:" in str(caught.value)
    assert message in str(caught.value)


def test_a_rig_file_is_told_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text("version: 1\nroot: a\ntargets: {b: {type: c}}\nsensors: {a: {type: d}}\n")
    with pytest.raises(ConfigError) as caught:
        load_calibration(path)
    assert str(caught.value) == (
        f"{path}: key 'format' is missing, expected a calibration with `format: rigcal-calibration`"
    )


@pytest.mark.parametrize(
    ("entry", "message"), [((0, 1), "not symmetric"), ((2, 2), "a negative eigenvalue")]
)
def test_matrix_that_is_no_covariance_is_refused(
    tmp_path: Path, entry: tuple[int, int], message: str
) -> None:
    covariance = np.eye(6)
    covariance[entry] = -1.0
    save_calibration(
        tmp_path / "c.yaml", Calibration("a", {"b": SensorResult("a", np.eye(4), covariance)})
    )
    with pytest.raises(ConfigError, match=message):
        load_calibration(tmp_path / "c.yaml")


def test_failed_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "calibration.yaml"
    path.write_text("old")

    def fail(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(Path, "write_text", fail)
        with pytest.raises(InputError, match="cannot be written: No space left on device"):
            save_calibration(path, _calibration())
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("calibration.yaml", "old")]


def test_place_that_is_no_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"calibration\.yaml: cannot be written"):
        save_calibration(tmp_path / "file" / "calibration.yaml", _calibration())
