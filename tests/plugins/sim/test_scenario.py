from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from rigcal.errors import ConfigError
from rigcal.plugin import Registry
from rigcal.rig import Rig
from rigcal_sim.scenario import ScenarioConfig
from rigcal_sim.scenario_file import load_scenario, scenario_schema, sensor_effects

GOOD = """\
version: 1
board:
  bearings_deg: [0, 72]
  radii_m: [1.5, 2.5]
  samples: 3
  height_m: [-0.1, 0.2]
room: {size_m: [9, 9, 3]}
defaults: {ranger: {drop_outs: 0.5}}
sensors:
  b: {clock_offset_s: 0.25}
"""
MakeRig = Callable[..., Rig]


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "scenario.yaml"
    path.write_text(text)
    return path


def test_a_scenario_file_is_read(tmp_path: Path, make_rig: MakeRig, registry: Registry) -> None:
    scenario = load_scenario(write(tmp_path, GOOD), make_rig(), registry)
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
        ("b: {", "bb: {", 10, "sensors.bb: the rig has no sensor 'bb', did you mean 'b'?"),
        ("clock_offset_s", "clock_ofset_s", 10, "sensors.b.clock_ofset_s: unknown key, did you"),
        ("0.25", "x", 10, "sensors.b.clock_offset_s: found 'x', expected a valid number"),
        ("ranger", "rangr", 8, "defaults.rangr: no sensor type 'rangr', did you mean 'ranger'?"),
        ("0.5", "1.5", 8, "defaults.ranger.drop_outs: found 1.5, expected a value less than or"),
    ],
)
def test_a_wrong_scenario_is_refused_with_its_line(
    tmp_path: Path,
    make_rig: MakeRig,
    registry: Registry,
    old: str,
    new: str,
    line: int | None,
    message: str,
) -> None:
    path = write(tmp_path, GOOD.replace(old, new))
    with pytest.raises(ConfigError) as caught:
        load_scenario(path, make_rig(), registry)
    text = str(caught.value)
    assert message in text
    assert text.startswith(f"{path}:{line}: " if line else f"{path}: ")


def test_a_sensor_has_its_own_effects_before_those_of_its_type(
    make_rig: MakeRig, registry: Registry
) -> None:
    board = {"bearings_deg": [0], "radii_m": [2]}
    scenario = ScenarioConfig.model_validate(
        {
            "board": board,
            "defaults": {"ranger": {"drop_outs": 0.5, "jitter_s": 0.01}},
            "sensors": {"b": {"drop_outs": 0.1}},
        }
    )
    effects = sensor_effects(scenario, make_rig(), registry)
    assert {name: e.model_dump(exclude_unset=True) for name, e in effects.items()} == {
        "a": {"drop_outs": 0.5, "jitter_s": 0.01},
        "b": {"drop_outs": 0.1, "jitter_s": 0.01},
    }


def test_the_schema_knows_the_effects_of_the_installed_types(registry: Registry) -> None:
    schema = scenario_schema(registry)
    sections = schema["$defs"]["ScenarioConfig"]["properties"]
    assert sections["defaults"]["properties"] == {"ranger": {"$ref": "#/$defs/RangerEffects"}}
    assert {"drop_outs", "rate_hz"} <= set(schema["$defs"]["RangerEffects"]["properties"])
    assert {"BoardConfig", "CoverConfig", "ContinuousConfig"} <= set(schema["$defs"])
