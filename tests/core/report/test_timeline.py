"""The viewer is an extra: without it the message says what to install."""

import sys

import numpy as np
import pytest

from rigcal.calibration import Calibration, SensorResult
from rigcal.errors import ConfigError, InputError
from rigcal.report import show_timeline, write_timeline


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


def test_a_folder_that_is_not_there(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", object())
    calibration = Calibration("a", {"a": SensorResult("a", np.eye(4))})
    with pytest.raises(InputError, match="there is no folder"):
        write_timeline(tmp_path / "no" / "line.rrd", calibration, [], None, None)
