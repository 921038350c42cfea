"""The viewer is an extra: without it the message says what to install."""

import sys

import numpy as np
import pytest

from rigcal.calibration import Calibration, SensorResult
from rigcal.errors import ConfigError, InputError, ObservationError
from rigcal.observation import Observation
from rigcal.plugin import SensorConfig
from rigcal.report import show_timeline, write_timeline
from rigcal.report.timeline import _upright
from rigcal.rig import Rig


@pytest.fixture
def without_rerun(monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)


@pytest.mark.usefixtures("without_rerun")
def test_it_says_what_to_install(tmp_path):
    calibration = Calibration("a", {"a": SensorResult("a", np.eye(4))})
    with pytest.raises(ConfigError, match=r'pip install "rigcal\[view\]"'):
        write_timeline(tmp_path / "line.rrd", calibration, [], None, None)
    with pytest.raises(ConfigError, match=r'pip install "rigcal\[view\]"'):
        show_timeline(calibration, [], None, None)
    assert not (tmp_path / "line.rrd").exists()


def _calibration(root, *others):
    return Calibration(root, {name: SensorResult(root, np.eye(4)) for name in (root, *others)})


def test_what_was_made_with_another_rig_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", object())
    path = tmp_path / "line.rrd"
    rig = Rig("cart", "a", {}, {"a": SensorConfig(type="eye"), "b": SensorConfig(type="eye")})
    own, other = _calibration("a", "b"), _calibration("a", "left")
    seen = Observation("left", "0000", 0, "left/0000.png", (), "")
    with pytest.raises(ObservationError, match=r"of left, which the rig does not name \(it has a,"):
        write_timeline(path, own, [seen], rig, None)
    with pytest.raises(ConfigError, match="of a, left places none of b of this rig"):
        write_timeline(path, other, [], rig, None)
    with pytest.raises(ConfigError, match="of a, left places none of b of this rig"):
        write_timeline(path, own, [], rig, None, before=other)
    assert not path.exists()


def test_a_file_that_the_viewer_would_not_know(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", object())
    with pytest.raises(InputError, match=r"line\.txt: expected a file that ends in \.rrd"):
        write_timeline(tmp_path / "line.txt", _calibration("a"), [], None, None)


def test_a_folder_that_is_not_there(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", object())
    calibration = Calibration("a", {"a": SensorResult("a", np.eye(4))})
    with pytest.raises(InputError, match="there is no folder"):
        write_timeline(tmp_path / "no" / "line.rrd", calibration, [], None, None)


@pytest.mark.parametrize("up", [(0, 0, 1), (0, -1, 0), (0.1, 0.2, -0.9), (0, 0, -1)])
def test_up_is_up_on_the_screen(up):
    """By the least rotation: what is across stays where it is."""
    up = np.array(up) / np.linalg.norm(up)
    R = _upright(up)
    np.testing.assert_allclose(R @ up, [0, 0, 1], atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    least = np.arccos(up[2])
    assert np.arccos(np.clip((np.trace(R) - 1) / 2, -1, 1)) == pytest.approx(least, abs=1e-6)
