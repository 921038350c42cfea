"""What one plugin offers, collected by its hooks and checked; PluginError says what is wrong."""

from __future__ import annotations

import difflib
import inspect
import re
import reprlib
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args, get_origin

import pluggy

from rigcal.errors import PluginError
from rigcal.plugin import hookspecs

if TYPE_CHECKING:
    from pydantic import BaseModel

    from rigcal.plugin.contract import SensorType
    from rigcal.targets.target import TargetType

Command = tuple[str, Callable[..., Any]]
FileSchema = tuple[str, Callable[..., dict[str, Any]]]
HOOKS = tuple(sorted(name for name in vars(hookspecs) if name.startswith("rigcal_")))
_NAME = re.compile(r"[a-z][a-z0-9_-]*")


@dataclass(frozen=True)
class Offer:
    """The checked objects of one plugin."""

    sensor_types: tuple[SensorType, ...] = ()
    target_types: tuple[TargetType, ...] = ()
    commands: tuple[Command, ...] = ()
    schemas: tuple[FileSchema, ...] = ()

    def __str__(self) -> str:
        words = [f"sensor type {s.name}" for s in self.sensor_types]
        words += [f"target type {t.name}" for t in self.target_types]
        words += [f"command {name}" for name, _ in self.commands]
        return ", ".join([*words, *(f"schema {name}" for name, _ in self.schemas)])


def collect(plugin: object, hooks: Collection[str] = HOOKS) -> Offer:
    """Call hooks of a plugin (module or object) and check what they return; PluginError if wrong.

    The sensor contract, and with it numpy and pydantic, is imported only for types.
    """
    _check_spelling(plugin)
    # A manager of its own: whatever is wrong with one plugin stays with it, and pluggy cannot
    # drop the second of two plugins with equal entry point names.
    manager = pluggy.PluginManager(hookspecs.PROJECT)
    manager.add_hookspecs(hookspecs)
    try:
        manager.register(plugin)
        manager.check_pending()
    except (pluggy.PluginValidationError, ValueError) as error:
        raise PluginError(" ".join(str(error).split())) from error
    parts = {
        hook.removeprefix("rigcal_"): tuple(_checked(hook, item) for item in _items(manager, hook))
        for hook in hooks
    }
    return Offer(**parts)


def _check_spelling(plugin: object) -> None:
    found = False
    for name in dir(plugin):
        value = getattr(plugin, name, None)
        marked = hasattr(value, f"{hookspecs.PROJECT}_impl")
        if not (inspect.isroutine(value) and (marked or name.startswith("rigcal_"))):
            continue
        if name not in HOOKS:
            nearest = difflib.get_close_matches(name, HOOKS, 1, 0.0)[0]
            raise PluginError(
                f"unknown hook '{name}', did you mean '{nearest}'? (hooks: {', '.join(HOOKS)})"
            )
        if not marked:
            raise PluginError(f"hook '{name}' lacks the decorator @rigcal.plugin.hookimpl")
        found = True
    if not found:
        raise PluginError(f"it implements no hook (hooks: {', '.join(HOOKS)})")


def _items(manager: pluggy.PluginManager, hook: str) -> Iterator[Any]:
    try:
        answers = getattr(manager.hook, hook)()
    except (Exception, SystemExit) as error:
        raise PluginError(f"{hook} failed with {type(error).__name__}: {error}") from error
    for answer in answers:
        if not isinstance(answer, (list, tuple)):
            raise PluginError(f"{hook} returned a {type(answer).__name__}, expected a list")
        yield from answer


def _checked(hook: str, item: Any) -> Any:
    match hook:
        case "rigcal_sensor_types":
            _check_sensor(item)
        case "rigcal_target_types":
            _check_target(item)
        case "rigcal_commands" | "rigcal_schemas":
            _check_named_function(hook, item)
    return item


def _check_sensor(sensor: Any) -> None:
    from rigcal.plugin.contract import CONTRACT_VERSION, Effects, SensorConfig, SensorType

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
    for part, function in vars(sensor).items():
        optional = SensorType.__dataclass_fields__[part].default is None
        if part not in _DATA_FIELDS and not (callable(function) or (optional and not function)):
            raise PluginError(
                f"sensor type '{sensor.name}': {part} is {function!r}, not a function"
            )


_DATA_FIELDS = {"name", "config", "message_types", "message_definitions", "unit", "message_type"}
_DATA_FIELDS |= {"contract", "effects", "flat"}


def _check_target(target: Any) -> None:
    from rigcal.targets.target import TargetConfig, TargetType

    if not isinstance(target, TargetType):
        raise PluginError(f"rigcal_target_types offers {_shown(target)}, expected a TargetType")
    _check_config("target type", target.name, target.config, TargetConfig)
    if not callable(target.build):
        raise PluginError(f"target type '{target.name}': build is {target.build!r}, not a function")


def _check_named_function(hook: str, item: Any) -> None:
    pair = isinstance(item, tuple) and len(item) == 2
    if not (pair and isinstance(item[0], str) and callable(item[1])):
        raise PluginError(f"{hook} offers {_shown(item)}, expected (name, function)")


def _shown(value: object) -> str:
    """A value in a message: short, and without an address."""
    name = getattr(value, "__name__", None)
    return f"the {type(value).__name__} '{name}'" if name else reprlib.repr(value)


def _check_config(kind: str, name: object, config: object, base: type[BaseModel]) -> None:
    if not (isinstance(name, str) and _NAME.fullmatch(name)):
        raise PluginError(f"{kind} {name!r}: a name has small letters, digits, _ and -")
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
