"""One small simulated recording for all tests of this folder."""

from pathlib import Path

import pytest

from rigcal.cli import main

HERE = Path(__file__).parent


@pytest.fixture(scope="session")
def run():
    """The command line; returns its exit status."""

    def run(*arguments):
        with pytest.raises(SystemExit) as caught:
            main([str(a) for a in arguments])
        return caught.value.code or 0

    return run


@pytest.fixture(scope="session")
def rig():
    return HERE / "cart.yaml"


@pytest.fixture(scope="session")
def simulated(tmp_path_factory, run, rig):
    out = tmp_path_factory.mktemp("simulated")
    scenario = HERE / "scenario.yaml"
    options = ("--scenario", scenario, "--seed", 1, "--bag", "--quiet")
    assert run("simulate", rig, "--out", out, *options) == 0
    return out


@pytest.fixture(scope="session")
def calibrated(tmp_path_factory, run, rig, simulated):
    out = tmp_path_factory.mktemp("calibrated")
    assert run("calibrate", rig, simulated / "recording.mcap", "--out", out, "--quiet") == 0
    return out
