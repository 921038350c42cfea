"""The rig file: what it means, and how it is refused."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest
from pydantic import BaseModel, ConfigDict, Field

from rigcal.errors import ConfigError
from rigcal.observation import Detection
from rigcal.plugin import Registry, SensorConfig, SensorType, hookimpl
from rigcal.rig import T_root_sensors, build_targets, load_rig, parse_rig, rig_schema
from rigcal.targets import Target, TargetConfig, TargetType


class Sweep(BaseModel):
    model_config = ConfigDict(extra="forbid")
    pattern: Literal["sweep"]
    step_deg: float


class Fixed(BaseModel):
    model_config = ConfigDict(extra="forbid")
    pattern: Literal["fixed"]


class SonarConfig(SensorConfig, frozen=True):
    type: Literal["sonar"] = "sonar"
    sigma_m: float = Field(gt=0)
    beams: tuple[int, int] = (1, 1)
    scan: Sweep | Fixed | None = Field(default=None, discriminator="pattern")


def _decode(message: object, config: object) -> object:
    return message


def _detect(frame: object, config: object, target: object) -> Detection:
    return Detection((), "deaf")


@hookimpl
def rigcal_sensor_types() -> list[SensorType]:
    return [SensorType("sonar", SonarConfig, (".csv",), _decode, _detect)]


class BentConfig(TargetConfig, frozen=True):
    type: Literal["bent"] = "bent"


def _build_bent(name: str, config: TargetConfig) -> Target:
    raise ValueError("the board is not flat")


@hookimpl
def rigcal_target_types() -> list[TargetType]:
    return [TargetType("bent", BentConfig, _build_bent)]


HOOKS = {"rigcal_sensor_types": rigcal_sensor_types, "rigcal_target_types": rigcal_target_types}
REGISTRY = Registry([SimpleNamespace(**HOOKS)])
RIG: dict[str, Any] = {
    "version": 1,
    "name": "boat",
    "root": "bow",
    "targets": {"board": {"type": "checkerboard", "columns": 7, "rows": 5, "square_size_m": 0.1}},
    "sensors": {
        "bow": {"type": "sonar", "topic": "/bow", "sigma_m": 0.01},
        "stern": {"type": "sonar", "topic": "/stern", "sigma_m": 0.01},
    },
}

POSTER = {
    "type": "apriltag_poster",
    "width_m": 1.0,
    "height_m": 0.5,
    "tags": [
        {"id": 1, "x_m": 0.0, "y_m": 0.0, "size_m": 0.2},
        {"id": 2, "x_m": 0.5, "y_m": 0.0, "size": 0.2},
    ],
}
QUARTER = {"w": 0.5**0.5, "x": 0.0, "y": 0.0, "z": 0.5**0.5}


def _rig(**changes: Any) -> dict[str, Any]:
    """RIG with values replaced, keys by path: `sensors__bow__topic`."""
    rig = copy.deepcopy(RIG)
    for path, value in changes.items():
        *parents, last = path.split("__")
        entry = rig
        for key in parents:
            entry = entry[key]
        entry[last] = value
    return rig


def _pose(parent: str, *translation: float, **more: Any) -> dict[str, Any]:
    return {"parent": parent, **({"translation_m": translation} if translation else {}), **more}


def _refused(rig: dict[str, Any]) -> str:
    with pytest.raises(ConfigError) as caught:
        parse_rig(rig, REGISTRY)
    return str(caught.value)


def test_valid_rig() -> None:
    rig = parse_rig(RIG, REGISTRY)
    assert (rig.name, rig.root, rig.association) == ("boat", "bow", None)
    assert isinstance(rig.sensors["bow"], SonarConfig)
    assert rig.target_of("stern") == "board"
    assert build_targets(rig, REGISTRY)["board"].points.shape == (35, 3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"root": "bows"}, "rig: root: no sensor 'bows', did you mean 'bow'? (has: bow, stern)"),
        ({"version": 2}, "rig: version: found 2, expected 1"),
        ({"tolerance_s": -1}, "rig: tolerance_s: found -1, expected a value greater than 0"),
        ({"rot": "bow"}, "rig: rot: unknown key, did you mean 'root'?"),
        ({"sensors": {}}, "rig: sensors: found a mapping, expected"),
        ({"sensors__bow": 3}, "rig: sensors.bow: found 3, expected a mapping with a `type`"),
        ({"sensors__bow": {}}, "rig: sensors.bow: key 'type' is missing"),
        ({"sensors__a b": {"type": "sonar"}}, "name 'a b': use letters"),
        ({"sensors__bow__type": "soner"}, "rig: sensors.bow.type: no sensor type 'soner', did you"),
        ({"sensors__bow__sigma_m": "x"}, "sensors.bow.sigma_m: found 'x', expected a valid number"),
        ({"sensors__bow__sigma_m": float("nan")}, "found nan, expected"),
        ({"sensors__bow__beams": [1, "x"]}, "rig: sensors.bow.beams[1]: found 'x', expected"),
        ({"sensors__bow__beams": [1]}, "bow.beams: the list is too short, expected 2 items"),
        ({"sensors__bow__target": "bord"}, "no target 'bord', did you mean 'board'? (has: board)"),
        ({"sensors__bow__fixed": True}, "rig: sensors.bow: fixed: true needs a pose"),
        ({"sensors__bow__pose": _pose("ster")}, "rig: sensors.bow.pose.parent: no sensor 'ster'"),
        ({"targets__board__type": "charucco"}, "no target type 'charucco', did you mean 'charuco'"),
        (
            {"targets__extra": RIG["targets"]["board"]},
            "rig: sensors.bow: add `target: NAME`, one of several (board, extra)",
        ),
        (
            {"sensors__bow__scan": {"pattern": "sweep", "step_dg": 1}},
            "rig: sensors.bow.scan.step_dg: unknown key, did you mean 'step_deg'?",
        ),
        (
            {"sensors__bow__scan": {"pattern": "sweep"}},
            "rig: sensors.bow.scan: key 'step_deg' is missing",
        ),
        (
            {"sensors__bow__pose": _pose("bow", 1, 2, 3)},
            "rig: sensors.bow.pose.parent: the poses go in a circle: bow -> bow",
        ),
        (
            {"sensors": 3},
            "rig: sensors: found 3, expected a mapping (`key: value` lines)",
        ),
        (
            {"sensors__bow__type": ["sonar"]},
            "rig: sensors.bow.type: found a list, expected the name of an installed type",
        ),
        (
            {"sensors__bow__pose": _pose("stern", 1, 2, 3) | {"rpy_deg": 90}},
            "rig: sensors.bow.pose.rpy_deg: found 90, expected a list",
        ),
        (
            {"sensors__bow__pose": _pose("stern", rpy_deg=(0, 0, 1), rotation=QUARTER)},
            "rig: sensors.bow.pose: give either rpy_deg or rotation, not both",
        ),
        (
            {"targets__board": POSTER},
            "rig: targets.board.tags[1].size: unknown key, did you mean 'size_m'?",
        ),
        (
            {"sensors__bow__refine": ["gain"]},
            "rig: sensors.bow.refine[0]: a sensor of type sonar has nothing to refine",
        ),
    ],
)
def test_wrong_rig_is_refused(changes: dict[str, Any], message: str) -> None:
    assert message in _refused(_rig(**changes))


def test_misspelt_required_key_is_one_mistake() -> None:
    rig = _rig()
    rig["sensors"]["bow"]["sigma"] = rig["sensors"]["bow"].pop("sigma_m")
    assert _refused(rig) == "rig: sensors.bow.sigma: unknown key, did you mean 'sigma_m'?"


def test_longer_circle_of_poses_is_told_once() -> None:
    text = _refused(_rig(sensors__bow__pose=_pose("stern"), sensors__stern__pose=_pose("bow")))
    assert text == "rig: sensors.bow.pose.parent: the poses go in a circle: bow -> stern -> bow"


def _load(tmp_path: Path, text: str) -> str:
    path = tmp_path / "rig.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_rig(path, REGISTRY)
    return str(caught.value).replace(str(tmp_path), "")


def test_all_problems_of_a_file_are_told_with_their_lines(tmp_path: Path) -> None:
    text = """\
version: 1
root: bo
targets:
  board: {type: checkerboard, columns: 7, rows: 5,
          square_m: 0.1}
sensors:
  bow:
    type: sonar
    sigma_m: 0
"""
    assert [line[:20] for line in _load(tmp_path, text).splitlines()] == [
        "/rig.yaml:2: root: n",
        "/rig.yaml:5: targets",
        "/rig.yaml:9: sensors",
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "/rig.yaml: the file is empty, expected a rig"),
        ("# nothing\n", "/rig.yaml: the file is empty, expected a rig"),
        ("- 1\n", "/rig.yaml: found a list, expected a rig: a mapping of keys"),
        ("root: [1\n", "/rig.yaml:2:1: not valid YAML: expected ',' or ']'"),
        ("\troot: a\n", "/rig.yaml:1:1: not valid YAML: found character '\\t'"),
        ("root: a\nroot: b\n", "/rig.yaml:2: root: the key stands twice in one mapping, first in"),
        ("a:\n  b: 1\n  b: 2\n", "/rig.yaml:3: a.b: the key stands twice"),
        ("on: 1\n", "/rig.yaml:1: YAML reads the key on as True, expected a word"),
        ("a: !!python/name:os.system 1\n", "/rig.yaml:1:4: not valid YAML"),
        ("a: 1\n---\nb: 2\n", "/rig.yaml:2:1: not valid YAML"),
        ("format: rigcal-verdict\n", "/rig.yaml:1: format: found 'rigcal-verdict', expected a rig"),
    ],
)
def test_file_that_is_no_rig(tmp_path: Path, text: str, message: str) -> None:
    assert _load(tmp_path, text).startswith(message)


def test_names_that_are_numbers_are_refused_beside_a_wrong_root() -> None:
    with pytest.raises(ConfigError) as caught:
        parse_rig(_rig(sensors={5: RIG["sensors"]["bow"]}), REGISTRY)
    assert "rig: root: no sensor 'bow' (has: 5)" in str(caught.value)
    assert "found 5, expected a valid string" in str(caught.value)


def test_a_rig_without_any_plugin_is_told_to_install_one() -> None:
    with pytest.raises(ConfigError) as caught:
        parse_rig(RIG, Registry())
    for sensor in ("bow", "stern"):
        assert f"rig: sensors.{sensor}.type: no sensor type 'sonar' (installed: none);" in str(
            caught.value
        )


def test_missing_file_and_folder(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such file, expected a rig"):
        load_rig(tmp_path / "rig.yaml", REGISTRY)
    with pytest.raises(ConfigError, match="cannot be read as a rig"):
        load_rig(tmp_path, REGISTRY)
    (tmp_path / "rig.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="not UTF-8"):
        load_rig(tmp_path / "rig.yaml", REGISTRY)


def test_merge_keys_of_yaml(tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text("""\
version: 1
root: bow
targets: {board: {type: checkerboard, columns: 7, rows: 5, square_size_m: 0.1}}
sensors:
  bow: &sonar {type: sonar, topic: /bow, sigma_m: 0.01}
  stern: {<<: *sonar, topic: /stern}
""")
    rig = load_rig(tmp_path / "rig.yaml", REGISTRY)
    assert rig.sensors["stern"].topic == "/stern"


def test_poses_compose_whatever_hangs_from_what() -> None:
    rig = parse_rig(
        _rig(
            sensors__bow__pose=_pose("mast", 1.0, 0.0, 0.0, rpy_deg=[0, 0, 90]),
            sensors__mast={"type": "sonar", "sigma_m": 0.01},
            sensors__stern__pose=_pose("mast", 1.0, 2.0, 0.0),
        ),
        REGISTRY,
    )
    T = T_root_sensors(rig)
    np.testing.assert_allclose(T["bow"], np.eye(4), atol=1e-12)
    # The bow's x axis is the mast's y axis: the stern is 2 m ahead of the bow.
    np.testing.assert_allclose(T["stern"][:3, 3], [2.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(T["mast"][:3, 3], [0.0, 1.0, 0.0], atol=1e-12)


def test_missing_pose_is_named() -> None:
    with pytest.raises(ConfigError, match="no pose connects stern to the root 'bow'"):
        T_root_sensors(parse_rig(RIG, REGISTRY))


def test_target_that_cannot_be_built_is_named() -> None:
    rig = parse_rig(_rig(targets__board={"type": "bent"}), REGISTRY)
    with pytest.raises(ConfigError, match=r"targets\.board: the board is not flat"):
        build_targets(rig, REGISTRY)


def test_schema_knows_the_installed_types() -> None:
    text = json.dumps(rig_schema(REGISTRY))
    assert '"const": "sonar"' in text
    assert '"const": "checkerboard"' in text
    assert "camera" not in text


def test_schema_without_a_plugin_knows_what_all_sensors_have() -> None:
    schema = rig_schema(Registry())
    assert "topic" in schema["$defs"]["SensorConfig"]["properties"]
    assert '"const": "sonar"' not in json.dumps(schema)
