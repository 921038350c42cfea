"""A plugin that is wrong gets a named error, and never takes down what does not use it."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import pytest

from rigcal.errors import PluginError
from rigcal.exporting import BUILTIN_EXPORTERS
from rigcal.importing import BUILTIN_IMPORTERS
from rigcal.observation import Detection
from rigcal.plugin import (
    Exporter,
    Importer,
    RecordingFormat,
    Registry,
    SensorConfig,
    SensorType,
    hookimpl,
)
from rigcal.plugin.offer import HOOKS
from rigcal.recording.folder import FolderRecording
from rigcal.targets import BUILTIN_TARGETS, Target, TargetConfig, TargetType


class SonarConfig(SensorConfig, frozen=True):
    type: Literal["sonar"] = "sonar"


class DiscConfig(TargetConfig, frozen=True):
    type: Literal["disc"] = "disc"


def _decode(message: object, config: object) -> object:
    return message


def _detect(frame: object, config: object, target: object) -> Detection:
    return Detection((), "deaf")


def _build(name: str, config: TargetConfig) -> Target:
    raise AssertionError("never asked to build here")


def _ping() -> None:
    """Ping."""


def _turn(angle: object) -> None:
    """Turn."""


# Typical: a name that is imported for type checkers only.
_turn.__annotations__["angle"] = "Angle"


SONAR = SensorType("sonar", SonarConfig, (".csv",), _decode, _detect)
DISC = TargetType("disc", DiscConfig, _build)
TAPE = RecordingFormat("tape", bool, FolderRecording)  # type: ignore[arg-type]
NOTES = Importer("notes", "lines", lambda text, stem: None)
LIST = Exporter("list", "names", lambda calibration, rig: ", ".join(calibration.sensors))
UNBUILT = TargetType("disc", DiscConfig, 1)  # type: ignore[arg-type]


def _plugin(hook: str, answer: object) -> object:
    def run() -> Any:
        return answer

    run.__name__ = hook
    return SimpleNamespace(__name__="fake", **{hook: hookimpl(run)})


def _sensors(*types: object) -> object:
    return _plugin("rigcal_sensor_types", list(types))


def _sonar(**changes: Any) -> object:
    return _sensors(replace(SONAR, **changes))


def test_rigcal_sensor_types_are_collected() -> None:
    registry = Registry([_sensors(SONAR)])
    assert registry.sensor_type("sonar") is SONAR
    assert list(registry.sensor_types) == ["sonar"]
    assert registry.plugins[1].offers == "sensor type sonar"


def test_rigcal_target_types_are_collected_beside_the_built_in_ones() -> None:
    registry = Registry([_plugin("rigcal_target_types", [DISC])])
    assert registry.target_type("disc") is DISC
    assert set(registry.target_types) == {"disc", *(t.name for t in BUILTIN_TARGETS)}


def test_rigcal_recording_formats_are_collected_beside_the_built_in_ones() -> None:
    registry = Registry([_plugin("rigcal_recording_formats", [TAPE])])
    assert list(registry.recording_formats) == ["bag", "folder", "tape"]
    assert registry.plugins[1].offers == "recording format tape"


def test_rigcal_importers_are_collected_beside_the_built_in_ones() -> None:
    registry = Registry([_plugin("rigcal_importers", [NOTES])])
    assert registry.importers["notes"] is NOTES
    assert set(registry.importers) == {"notes", *(i.name for i in BUILTIN_IMPORTERS)}


def test_rigcal_exporters_are_collected_beside_the_built_in_ones() -> None:
    registry = Registry([_plugin("rigcal_exporters", [LIST])])
    assert registry.exporter("list") is LIST
    assert set(registry.exporters) == {"list", *(e.name for e in BUILTIN_EXPORTERS)}
    with pytest.raises(PluginError, match=r"no exporter 'lits', did you mean 'list'\?"):
        registry.exporter("lits")


def test_rigcal_commands_are_collected() -> None:
    registry = Registry([_plugin("rigcal_commands", [("ping", _ping)])])
    assert registry.commands == {"ping": _ping}


def test_rigcal_schemas_are_collected() -> None:
    registry = Registry([_plugin("rigcal_schemas", [("notes", dict)])])
    assert registry.schemas == {"notes": dict}
    assert registry.plugins[1].offers == "schema notes"


def test_every_hook_has_a_test_here() -> None:
    tests = [name for name in globals() if name.startswith("test_")]
    for hook in HOOKS:
        assert any(name.startswith(f"test_{hook}") for name in tests), hook


def test_registry_can_be_sent_to_another_process() -> None:
    registry = pickle.loads(pickle.dumps(Registry([_sensors(SONAR)])))
    assert registry.sensor_type("sonar") == SONAR


def _failing_plugin() -> object:
    def rigcal_commands() -> Sequence[Any]:
        raise ZeroDivisionError("division by zero")

    return SimpleNamespace(rigcal_commands=hookimpl(rigcal_commands))


class _Untyped(SensorConfig, frozen=True):
    pass


@pytest.mark.parametrize(
    ("plugin", "message"),
    [
        (_plugin("rigcal_sensor_typs", []), "did you mean 'rigcal_sensor_types'"),
        (_plugin("sensor_types", []), "did you mean 'rigcal_sensor_types'"),
        (SimpleNamespace(rigcal_commands=_ping), "lacks the decorator"),
        (SimpleNamespace(other=1), "implements no hook"),
        (_sensors("sonar"), "offers 'sonar', expected a SensorType"),
        (_sensors(DISC), "expected a SensorType"),
        (_plugin("rigcal_sensor_types", SONAR), "returned a SensorType, expected a list"),
        (_sonar(contract=99), "version 99 of the plugin contract"),
        (_sonar(name="Sonar 2"), "'Sonar 2': a name has small letters"),
        (_sonar(name="radar"), 'type: Literal["radar"] = "radar"'),
        (_sonar(config=_Untyped), 'type: Literal["sonar"] = "sonar"'),
        (_sonar(config=DiscConfig), "expected a SensorConfig class"),
        (_sonar(message_types=".csv"), "expected a tuple of names"),
        (_sonar(detect=None), "detect is None, not a function"),
        (_sonar(residual=3), "residual is 3, not a function"),
        (_sonar(effects=int), "effects is <class 'int'>, expected an Effects class"),
        (_sonar(refinable={"lens": 1}), "refinable is {'lens': 1}, expected a Refinable by name"),
        (_sonar(message_definitions={"a": 1}), "expected the text of a .msg file by ROS name"),
        (_failing_plugin(), "rigcal_commands failed with ZeroDivisionError"),
        (_plugin("rigcal_target_types", [UNBUILT]), "build is 1, not a function"),
        (_plugin("rigcal_target_types", [SONAR]), "expected a TargetType"),
        (_plugin("rigcal_recording_formats", [_ping]), "expected a RecordingFormat"),
        (_plugin("rigcal_recording_formats", [replace(TAPE, open=".clf")]), "open is '.clf', not"),
        (_plugin("rigcal_importers", [NOTES.read]), "expected an Importer"),
        (_plugin("rigcal_importers", [replace(NOTES, read="a")]), "read is 'a', not a function"),
        (_sensors(replace(SONAR, describes={"a/msg/B": 3})), "describes is {'a/msg/B': 3}, exp"),
        (_plugin("rigcal_exporters", [LIST.text]), "expected an Exporter"),
        (_plugin("rigcal_exporters", [replace(LIST, name="My list")]), "'My list': a name has"),
        (_plugin("rigcal_exporters", [replace(LIST, text="a, b")]), "text is 'a, b', not a func"),
        (_plugin("rigcal_commands", [_ping]), "rigcal_commands offers"),
        (_plugin("rigcal_commands", [("turn", _turn)]), "NameError: name 'Angle' is not defined"),
        (_plugin("rigcal_schemas", [("notes", 1)]), "expected (name, function)"),
    ],
)
def test_wrong_plugin_is_refused_with_its_mistake(plugin: object, message: str) -> None:
    with pytest.raises(PluginError) as caught:
        Registry([plugin])
    assert message in str(caught.value)


def test_hook_with_unknown_argument_is_refused() -> None:
    def rigcal_commands(app: object) -> Sequence[Any]:
        return []

    with pytest.raises(PluginError, match="app"):
        Registry([SimpleNamespace(rigcal_commands=hookimpl(rigcal_commands))])


def test_unknown_type_names_the_nearest_and_the_installed() -> None:
    with pytest.raises(PluginError, match=r"'sonarr', did you mean 'sonar'\? \(installed: sonar\)"):
        Registry([_sensors(SONAR)]).sensor_type("sonarr")
    unlike = r"'radar' \(installed: sonar\); install the plugin that offers it"
    with pytest.raises(PluginError, match=unlike):
        Registry([_sensors(SONAR)]).sensor_type("radar")


Install = Callable[..., None]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Install a distribution with one plugin module, as pip would lay it out."""
    monkeypatch.syspath_prepend(str(tmp_path))

    def run(distribution: str, source: str, entry: str = "acme", module: str = "") -> None:
        name = distribution.replace("-", "_")
        module = module or name
        (tmp_path / f"{name}.py").write_text(source)
        info = tmp_path / f"{name}-1.2.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.2\n"
        )
        (info / "entry_points.txt").write_text(f"[rigcal]\n{entry} = {module}\n")

    return run


DISC_SOURCE = """
from typing import Literal
from rigcal.plugin import hookimpl
from rigcal.targets import TargetConfig, TargetType
class DiscConfig(TargetConfig, frozen=True):
    type: Literal["disc"] = "disc"
def build(name, config): ...
@hookimpl
def rigcal_target_types(): return [TargetType("disc", DiscConfig, build)]
"""


def test_broken_plugin_is_left_out_and_named_only_where_it_matters(install: Install) -> None:
    install("acme-disc", "import a_library_that_is_missing", entry="disc")
    registry = Registry.from_entry_points()
    assert registry.target_type("checkerboard").name == "checkerboard"
    (broken,) = (b for b in registry.broken if b.distribution == "acme-disc")
    assert (broken.name, broken.version) == ("disc", "1.2")
    assert "ModuleNotFoundError: No module named 'a_library_that_is_missing'" in broken.error
    with pytest.raises(PluginError, match="pip uninstall acme-disc"):
        registry.target_type("disc")
    with pytest.raises(PluginError, match=r"a broken plugin may have offered it: .*acme-disc"):
        registry.target_type("hexagon")


@pytest.mark.parametrize("source", ["raise SystemExit(3)", "def f(:", "1 / 0"])
def test_plugin_may_fail_in_any_way(install: Install, source: str) -> None:
    install("acme-exits", source)
    assert "acme-exits" in {b.distribution for b in Registry.from_entry_points().broken}


def test_name_offered_twice_is_an_error_for_who_asks_for_it(install: Install) -> None:
    install("acme-disc", DISC_SOURCE)
    install("other-disc", DISC_SOURCE)  # under the same entry point name
    registry = Registry.from_entry_points()
    assert "disc" not in registry.target_types
    assert registry.target_type("charuco").name == "charuco"
    with pytest.raises(PluginError) as caught:
        registry.target_type("disc")
    assert str(caught.value) == (
        "target type 'disc' is offered by 'acme' of acme-disc 1.2 and by 'acme' of other-disc 1.2; "
        "uninstall all but one of them: pip uninstall acme-disc, pip uninstall other-disc"
    )
    offers = {p.distribution: p.offers for p in registry.plugins}
    assert offers["acme-disc"] == offers["other-disc"] == ""


def test_a_name_of_rigcals_own_stays_its_own(install: Install) -> None:
    install("acme-board", DISC_SOURCE.replace("disc", "charuco"))
    install("acme-command", COMMAND_SOURCE.replace('"ping", ping', '"plan", ping), ("pong", ping'))
    registry = Registry.from_entry_points()
    assert registry.target_type("charuco") in BUILTIN_TARGETS
    assert registry.commands.keys() & {"plan", "pong"} == {"pong"}
    errors = {b.distribution: b.error for b in registry.broken}
    assert errors["acme-board"] == "target type 'charuco' is rigcal's own"
    assert errors["acme-command"] == "command 'plan' is rigcal's own"
    offers = {p.distribution: p.offers for p in registry.plugins}
    assert (offers["acme-board"], offers["acme-command"]) == ("", "command pong")


def test_equal_entry_point_names_of_different_plugins_both_work(install: Install) -> None:
    install("acme-disc", DISC_SOURCE)
    install("acme-ring", DISC_SOURCE.replace("disc", "ring"))
    registry = Registry.from_entry_points()
    assert {"disc", "ring"} <= set(registry.target_types)


def test_asked_for_commands_a_plugin_without_them_is_not_imported(install: Install) -> None:
    install("acme-heavy", "raise AssertionError('imported')")
    install("acme-ping", COMMAND_SOURCE)
    install("acme-pong", "from acme_ping import *", entry="pong")
    registry = Registry.from_entry_points(hooks=("rigcal_commands",))
    assert "acme-heavy" not in {b.distribution for b in registry.broken}
    assert {"acme-ping", "acme-pong"} <= {p.distribution for p in registry.plugins}


def test_an_entry_point_may_name_an_object_of_its_module(install: Install) -> None:
    install("acme-plugin", OBJECT_SOURCE, module="acme_plugin:PLUGIN")
    registry = Registry.from_entry_points(hooks=("rigcal_commands",))
    assert "pong" in registry.commands


OBJECT_SOURCE = """
from rigcal.plugin import hookimpl
def pong(): ...
class Plugin:
    @hookimpl
    def rigcal_commands(self): return [("pong", pong)]
PLUGIN = Plugin()
"""
COMMAND_SOURCE = """
from rigcal.plugin import hookimpl
def ping(): ...
@hookimpl
def rigcal_commands(): return [("ping", ping)]
"""


def test_every_hook_has_a_heading_in_the_documentation() -> None:
    page = Path(__file__).parents[3] / "docs" / "plugin-contract.md"
    headings = [line for line in page.read_text().splitlines() if line.startswith("### ")]
    assert sorted(headings) == [f"### `{hook}`" for hook in HOOKS]
