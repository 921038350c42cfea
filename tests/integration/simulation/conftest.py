from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def rig_file() -> Path:
    return Path(__file__).parent / "rig.yaml"


@pytest.fixture(scope="session")
def scenario_file() -> Path:
    return Path(__file__).parent / "scenario.yaml"
