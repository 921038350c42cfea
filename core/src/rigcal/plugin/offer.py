"""What one plugin offers, collected by its hooks and checked; PluginError says what is wrong."""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any, NamedTuple

import pluggy

from rigcal.errors import PluginError
from rigcal.plugin import hookspecs
from rigcal.plugin.checks import CHECKS, kind_of

KINDS = {
    "rigcal_sensor_types": "sensor type",
    "rigcal_target_types": "target type",
    "rigcal_recording_formats": "recording format",
    "rigcal_exporters": "exporter",
    "rigcal_importers": "importer",
    "rigcal_commands": "command",
    "rigcal_schemas": "schema",
}
"""What people call what a hook hands over."""
HOOKS = tuple(sorted(KINDS))
OWN_NAMES = {
    "rigcal_commands": (
        "init",
        "detect",
        "calibrate",
        "plan",
        "evaluate",
        "compare",
        "validate",
        "export",
        "fuse",
        "view",
        "target",
        "plugins",
        "new-plugin",
        "schema",
    ),
    "rigcal_schemas": ("rig",),
}
"""Names that plugins cannot take, of what core offers beside its own objects of the hooks."""
Offer = Mapping[str, tuple[Any, ...]]
"""The checked objects of one plugin by hook; each has a `name`."""


class Command(NamedTuple):
    """A command: what follows `rigcal`, and a function with typer annotations."""

    name: str
    run: Callable[..., Any]


class FileSchema(NamedTuple):
    """A file that `rigcal schema NAME` describes: `make(registry)` is its JSON Schema."""

    name: str
    make: Callable[..., dict[str, Any]]


_PAIRS: dict[str, Callable[..., Any]] = {"rigcal_commands": Command, "rigcal_schemas": FileSchema}


def in_words(offer: Offer) -> str:
    """A list like: sensor type camera, command demo."""
    return ", ".join(f"{KINDS[hook]} {item.name}" for hook in KINDS for item in offer.get(hook, ()))


def collect(plugin: object, hooks: Collection[str] = HOOKS) -> Offer:
    """Call hooks of a plugin (module or object) and check what they return; PluginError if wrong.

    The contracts, and with them numpy and pydantic, are imported only for what needs them.
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
    return {hook: tuple(_checked(hook, item) for item in _items(manager, hook)) for hook in hooks}


def _checked(hook: str, item: Any) -> Any:
    CHECKS[hook](item)
    return _PAIRS[hook](*item) if hook in _PAIRS else item


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
            raise PluginError(f"{hook} returned {kind_of(answer)}, expected a list")
        yield from answer
