"""What one plugin offers, collected by its hooks and checked; PluginError says what is wrong."""

from __future__ import annotations

import difflib
import inspect
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Literal, get_args, get_origin

import pluggy
from pydantic import BaseModel

from rigcal.errors import PluginError
from rigcal.plugin import hookspecs
from rigcal.plugin.contract import CONTRACT_VERSION, SensorConfig, SensorType
from rigcal.targets.target import TargetConfig, TargetType

Command = tuple[str, Callable[..., Any]]
HOOKS = tuple(sorted(name for name in vars(hookspecs) if name.startswith("rigcal_")))
_NAME = re.compile(r"[a-z][a-z0-9_-]*")


@dataclass(frozen=True)
class Offer:
    """The checked objects of one plugin."""

    sensor_types: tuple[SensorType, ...]
    target_types: tuple[TargetType, ...]
    commands: tuple[Command, ...]


def collect(plugin: object) -> Offer:
    """Call a plugin's hooks (module or object) and check what they return; PluginError if wrong."""
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
    sensor_types = tuple(_items(manager, "rigcal_sensor_types", SensorType))
    target_types = tuple(_items(manager, "rigcal_target_types", TargetType))
    commands = tuple(_items(manager, "rigcal_commands", tuple))
    for sensor in sensor_types:
        _check_sensor(sensor)
    for target in target_types:
        _check_config("target type", target.name, target.config, TargetConfig)
        _check_callable("target type", target.name, "build", target.build)
    for command in commands:
        _check_command(command)
    return Offer(sensor_types, target_types, commands)


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


def _items(manager: pluggy.PluginManager, hook: str, kind: type[Any]) -> Iterable[Any]:
    try:
        answers = getattr(manager.hook, hook)()
    except (Exception, SystemExit) as error:
        raise PluginError(f"{hook} failed with {type(error).__name__}: {error}") from error
    expected = "(name, function)" if kind is tuple else kind.__name__
    for answer in answers:
        if not isinstance(answer, (list, tuple)):
            raise PluginError(
                f"{hook} returned a {type(answer).__name__}, expected a list of {expected}"
            )
        for item in answer:
            if not isinstance(item, kind):
                raise PluginError(f"{hook} offers {item!r}, expected {expected}")
            yield item


def _check_sensor(sensor: SensorType) -> None:
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
    for name in ("decode", "detect"):
        _check_callable("sensor type", sensor.name, name, getattr(sensor, name))
    for name in ("residual", "errors", "simulate", "encode", "extra_messages", "sees"):
        if getattr(sensor, name) is not None:
            _check_callable("sensor type", sensor.name, name, getattr(sensor, name))


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


def _check_callable(kind: str, name: str, part: str, value: object) -> None:
    if not callable(value):
        raise PluginError(f"{kind} '{name}': {part} is {value!r}, expected a function")


def _check_command(command: tuple[Any, ...]) -> None:
    if len(command) != 2 or not isinstance(command[0], str) or not callable(command[1]):
        raise PluginError(f"rigcal_commands offers {command!r}, expected (name, function)")
