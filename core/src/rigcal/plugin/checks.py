"""What is wrong with an object that a hook handed over."""

from __future__ import annotations

import re
import reprlib
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Literal, get_args, get_origin

from rigcal.errors import PluginError

if TYPE_CHECKING:
    from pydantic import BaseModel

_NAME = re.compile(r"[a-z][a-z0-9_-]*")


def kind_of(value: object) -> str:
    """What a value is, in a message: "a str", "an int", "nothing"."""
    name = type(value).__name__
    return "nothing" if value is None else f"{'an' if name[0] in 'aeiou' else 'a'} {name}"


def _check_sensor(sensor: Any) -> None:
    from rigcal.plugin.contract import CONTRACT_VERSION, Effects, SensorConfig, SensorType
    from rigcal.plugin.refinable import Refinable

    if not isinstance(sensor, SensorType):
        raise PluginError(f"rigcal_sensor_types offers {_shown(sensor)}, expected a SensorType")
    if sensor.contract != CONTRACT_VERSION:
        raise PluginError(
            f"sensor type '{sensor.name}' follows version {sensor.contract} of the plugin "
            f"contract, this rigcal version {CONTRACT_VERSION}: install versions that agree"
        )
    _check_config("sensor type", sensor.name, sensor.config, SensorConfig)
    kinds = sensor.message_types
    if isinstance(kinds, str) or not kinds or not all(isinstance(k, str) for k in kinds):
        raise PluginError(
            f"sensor type '{sensor.name}': message_types is {kinds!r}, expected a tuple of names"
        )
    texts = sensor.message_definitions
    if not (
        isinstance(texts, Mapping) and all(isinstance(t, str) for t in (*texts, *texts.values()))
    ):
        raise PluginError(
            f"sensor type '{sensor.name}': message_definitions is {texts!r}, expected the text of "
            "a .msg file by ROS name"
        )
    if not (isinstance(sensor.effects, type) and issubclass(sensor.effects, Effects)):
        raise PluginError(
            f"sensor type '{sensor.name}': effects is {sensor.effects!r}, expected an Effects class"
        )
    offered = sensor.refinable
    if not (
        isinstance(offered, Mapping) and all(isinstance(r, Refinable) for r in offered.values())
    ):
        raise PluginError(
            f"sensor type '{sensor.name}': refinable is {offered!r}, expected a Refinable by name"
        )
    described = sensor.describes
    if not (isinstance(described, Mapping) and all(callable(d) for d in described.values())):
        raise PluginError(
            f"sensor type '{sensor.name}': describes is {described!r}, expected a function by ROS "
            "name"
        )
    for part, function in vars(sensor).items():
        optional = SensorType.__dataclass_fields__[part].default is None
        if part not in _DATA_FIELDS and not (callable(function) or (optional and not function)):
            raise PluginError(
                f"sensor type '{sensor.name}': {part} is {function!r}, not a function"
            )


_DATA_FIELDS = {"name", "config", "message_types", "message_definitions", "unit", "message_type"}
_DATA_FIELDS |= {"contract", "describes", "effects", "flat", "angular", "refinable", "bends"}


def _check_target(target: Any) -> None:
    from rigcal.targets.target import TargetConfig, TargetType

    if not isinstance(target, TargetType):
        raise PluginError(f"rigcal_target_types offers {_shown(target)}, expected a TargetType")
    _check_config("target type", target.name, target.config, TargetConfig)
    _check_functions("target type", target, ("build",))


def _check_format(form: Any) -> None:
    from rigcal.recording.format import RecordingFormat

    if not isinstance(form, RecordingFormat):
        raise PluginError(
            f"rigcal_recording_formats offers {_shown(form)}, expected a RecordingFormat"
        )
    _check_name("recording format", form.name)
    _check_functions("recording format", form, ("accepts", "open"))


def _check_exporter(exporter: Any) -> None:
    from rigcal.exporting.exporter import Exporter

    if not isinstance(exporter, Exporter):
        raise PluginError(f"rigcal_exporters offers {_shown(exporter)}, expected an Exporter")
    _check_name("exporter", exporter.name)
    _check_functions("exporter", exporter, ("text",))


def _check_importer(importer: Any) -> None:
    from rigcal.importing.importer import Importer

    if not isinstance(importer, Importer):
        raise PluginError(f"rigcal_importers offers {_shown(importer)}, expected an Importer")
    _check_name("importer", importer.name)
    _check_functions("importer", importer, ("read",))


def _check_command(command: Any) -> None:
    import typer

    _check_pair("rigcal_commands", command)
    name, run = command
    alone = typer.Typer(add_completion=False)
    try:
        alone.command(name)(run)
        typer.main.get_command(alone)
    except Exception as error:
        raise PluginError(
            f"command '{name}': typer makes no command of its function: "
            f"{type(error).__name__}: {error}"
        ) from error


def _check_schema(schema: Any) -> None:
    _check_pair("rigcal_schemas", schema)


def _check_pair(hook: str, item: Any) -> None:
    pair = isinstance(item, tuple) and len(item) == 2
    if not (pair and isinstance(item[0], str) and callable(item[1])):
        raise PluginError(f"{hook} offers {_shown(item)}, expected (name, function)")


CHECKS: dict[str, Callable[[Any], None]] = {
    "rigcal_sensor_types": _check_sensor,
    "rigcal_target_types": _check_target,
    "rigcal_recording_formats": _check_format,
    "rigcal_exporters": _check_exporter,
    "rigcal_importers": _check_importer,
    "rigcal_commands": _check_command,
    "rigcal_schemas": _check_schema,
}
"""By hook: PluginError unless the object is what the hook hands over."""


def _shown(value: object) -> str:
    """A value in a message: short, and without an address."""
    name = getattr(value, "__name__", None)
    return f"the {type(value).__name__} '{name}'" if name else reprlib.repr(value)


def _check_config(kind: str, name: object, config: object, base: type[BaseModel]) -> None:
    _check_name(kind, name)
    if not (isinstance(config, type) and issubclass(config, base)):
        raise PluginError(
            f"{kind} '{name}': config is {config!r}, expected a {base.__name__} class"
        )
    annotation = config.model_fields["type"].annotation
    if get_origin(annotation) is not Literal or get_args(annotation) != (name,):
        raise PluginError(
            f"{kind} '{name}': {config.__name__}.type must be declared "
            f'`type: Literal["{name}"] = "{name}"`'
        )


def _check_name(kind: str, name: object) -> None:
    if not (isinstance(name, str) and _NAME.fullmatch(name)):
        raise PluginError(f"{kind} {name!r}: a name has small letters, digits, _ and -")


def _check_functions(kind: str, offer: Any, parts: tuple[str, ...]) -> None:
    for part in parts:
        function = getattr(offer, part)
        if not callable(function):
            raise PluginError(f"{kind} '{offer.name}': {part} is {function!r}, not a function")
