"""One small simulated recording for all tests of this folder."""

from pathlib import Path

import pytest

HERE = Path(__file__).parent


@pytest.fixture(scope="session")
def rig():
    return HERE / "cart.yaml"


@pytest.fixture(scope="session")
def simulated(tmp_path_factory, command, rig):
    out = tmp_path_factory.mktemp("simulated")
    scenario = HERE / "scenario.yaml"
    options = ("--scenario", scenario, "--seed", 1, "--bag", "--quiet")
    assert command("simulate", rig, "--out", out, *options).code == 0
    return out


@pytest.fixture(scope="session")
def calibrated(tmp_path_factory, command, rig, simulated):
    out = tmp_path_factory.mktemp("calibrated")
    recording = simulated / "recording.mcap"
    assert command("calibrate", rig, recording, "--out", out, "--quiet").code == 0
    return out
