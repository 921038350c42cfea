from __future__ import annotations

from pathlib import Path

import pytest

from rigcal.errors import ConfigError
from rigcal_sim.scenario import load_scenario

GOOD = """\
version: 1
board:
  bearings_deg: [0, 72]
  radii_m: [1.5, 2.5]
  samples: 3
  height_m: [-0.1, 0.2]
room: {size_m: [9, 9, 3]}
"""


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "scenario.yaml"
    path.write_text(text)
    return path


def test_a_scenario_file_is_read(tmp_path: Path) -> None:
    scenario = load_scenario(write(tmp_path, GOOD))
    assert scenario.board.heights_m == (-0.1, 0.2)
    assert scenario.min_sensors == 2
    assert not scenario.person


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("samples: 3", "sample: 3", 5, "board.sample: "),
        ("[1.5, 2.5]", "[1.5, 0]", 2, "board: radii_m holds 0; all must be above 0"),
        ("[0, 72]", "[]", 3, "board.bearings_deg: "),
        ("[-0.1, 0.2]", "[0.2, -0.1]", 2, "height_m goes from 0.2 to -0.1; write the lower"),
        ("[-0.1, 0.2]", "-1.5", None, "board.height_m -1.5 is not above floor_m -1;"),
        ("[-0.1, 0.2]", "2.5", None, "above the ceiling at 2; make room.size_m[2] larger"),
        ("[9, 9, 3]", "[9, -9, 3]", 7, "all three must be above 0"),
        ("version: 1", "version: 2", 1, "version: "),
        ("version: 1", "stamps: {jitter_s: 0.5}", 1, "jitter_s 0.5 mixes exposures 1 s apart"),
    ],
)
def test_a_wrong_scenario_is_refused_with_its_line(
    tmp_path: Path, old: str, new: str, line: int | None, message: str
) -> None:
    path = write(tmp_path, GOOD.replace(old, new))
    with pytest.raises(ConfigError) as caught:
        load_scenario(path)
    text = str(caught.value)
    assert message in text
    assert text.startswith(f"{path}:{line}: " if line else f"{path}: ")
