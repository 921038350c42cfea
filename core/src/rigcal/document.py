"""YAML files with line numbers, validated by pydantic; all that is wrong is told at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from rigcal.errors import ConfigError
from rigcal.validation import Key, explain

_M = TypeVar("_M", bound=BaseModel)
Place = tuple[Key, ...]


@dataclass(frozen=True)
class Document:
    """The mapping that a file holds; `lines` tells where in it each key stands."""

    name: str
    data: dict[Any, Any]
    lines: Mapping[Place, int] = field(default_factory=dict)

    def where(self, path: Place) -> str:
        """`rig.yaml:12: sensors.cam0.topic`, with the line of the nearest key above if need be."""
        line = self.line(path)
        place = f"{self.name}:{line}" if line else self.name
        return f"{place}: {dotted(path)}" if path else place

    def line(self, path: Place) -> int:
        """Line of a path, or of the nearest key above it; 0 where no lines are known."""
        while path and path not in self.lines:
            path = path[:-1]
        return self.lines.get(path, 0)


class Problems:
    """What is wrong in a document, one line each, raised as one ConfigError."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self._found: list[tuple[Place, str]] = []

    def add(self, path: Place, text: str) -> None:
        """Note what is wrong at a path such as ("sensors", "cam0")."""
        self._found.append((path, text))

    def validate(self, model: type[_M], data: dict[Any, Any], path: Place = ()) -> _M | None:
        """`data` as an instance of `model`, or None after noting every error in it."""
        try:
            return model.model_validate(data)
        except ValidationError as error:
            for inner, text in explain(error, model, data):
                self.add((*path, *inner), text)
            return None

    def raise_if_any(self) -> None:
        """ConfigError listing everything found, in the order of the file's lines."""
        if self._found:
            where = self.document.where
            ordered = sorted(self._found, key=lambda found: self.document.line(found[0]))
            raise ConfigError("\n".join(f"{where(path)}: {text}" for path, text in ordered))


def describe(data: object) -> str:
    """A value as a message shows it."""
    if data is None:
        return "nothing"
    if isinstance(data, dict):
        return "a mapping"
    if isinstance(data, list):
        return "a list"
    return repr(data)


def dotted(path: Place) -> str:
    """`sensors.cam0.focal_px[1]`."""
    text = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in path)
    return text.removeprefix(".")


def read_document(path: Path | str, holds: str) -> Document:
    """The mapping in a YAML file; `holds` says what it should be ("a rig").

    ConfigError when the file is missing, unreadable, empty, not YAML, not a mapping, or names a
    key twice.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file, expected {holds} in YAML") from None
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise ConfigError(f"{path}: cannot be read as {holds}: {reason}") from error
    try:
        loader = yaml.SafeLoader(text)
        node = loader.get_single_node()
        if node is None:
            raise ConfigError(f"{path}: the file is empty, expected {holds}")
        lines: dict[Place, int] = {}
        _walk(loader, node, (), lines, str(path))
        data = loader.construct_document(node)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f"{path}:{mark.line + 1}:{mark.column + 1}" if mark else str(path)
        raise ConfigError(f"{place}: not valid YAML: {error.problem or error.context}") from error
    except yaml.YAMLError as error:  # control characters
        raise ConfigError(f"{path}: not valid YAML: {' '.join(str(error).split())}") from error
    except RecursionError as error:
        raise ConfigError(
            f"{path}: found lists or mappings that go too deep, expected {holds}; an alias "
            "(`*name`) may stand inside of what it stands for"
        ) from error
    if not isinstance(data, dict):
        raise ConfigError(f"{path}: found {describe(data)}, expected {holds}: a mapping of keys")
    return Document(str(path), data, lines)


def check_format(document: Document, expected: str | None, holds: str) -> None:
    """ConfigError for a file of another kind than `holds`, told by its key `format`.

    One line for all, instead of one for every key that the kinds do not share. `expected` is None
    for a kind that names no format.
    """
    found = document.data.get("format")
    if expected is None and isinstance(found, str) and found.startswith("rigcal-"):
        raise ConfigError(f"{document.where(('format',))}: found '{found}', expected {holds}")
    if expected is not None and found is None:
        raise ConfigError(
            f"{document.name}: key 'format' is missing, expected {holds} with `format: {expected}`"
        )
    if expected is not None and found != expected:
        place = document.where(("format",))
        raise ConfigError(f"{place}: found {describe(found)}, expected '{expected}', {holds}")


def _walk(
    loader: yaml.SafeLoader, node: yaml.Node, path: Place, lines: dict[Place, int], name: str
) -> None:
    """Note the line of every key and item; refuse a key that stands twice in one mapping, and
    values that cannot be read.
    """
    if isinstance(node, yaml.ScalarNode):
        _scalar(loader, node, f"{name}:{node.start_mark.line + 1}: {dotted(path)}".rstrip(": "))
    elif isinstance(node, yaml.SequenceNode):
        for index, item in enumerate(node.value):
            lines.setdefault((*path, index), item.start_mark.line + 1)
            _walk(loader, item, (*path, index), lines, name)
    else:
        seen: dict[Key, int] = {}
        for key_node, value in node.value:
            if key_node.tag == "tag:yaml.org,2002:merge":
                continue
            line = key_node.start_mark.line + 1
            key = _key(loader, key_node, f"{name}:{line}: {dotted(path)}".rstrip(": "))
            if key in seen:
                raise ConfigError(
                    f"{name}:{line}: {dotted((*path, key))}: the key stands twice in one mapping, "
                    f"first in line {seen[key]}; remove or rename one"
                )
            seen[key] = lines[(*path, key)] = line
            _walk(loader, value, (*path, key), lines, name)


def _key(loader: yaml.SafeLoader, node: yaml.Node, where: str) -> Key:
    if isinstance(node, yaml.ScalarNode):
        key = _scalar(loader, node, where)
        if isinstance(key, (str, int)) and not isinstance(key, bool):
            return key
        raise ConfigError(
            f"{where}: YAML reads the key {node.value} as {key!r}, expected a word: "
            f'write "{node.value}" in quotes'
        )
    raise ConfigError(f"{where}: found a list or mapping as a key, expected a word")


def _scalar(loader: yaml.SafeLoader, node: yaml.ScalarNode, where: str) -> Any:
    try:
        return loader.construct_object(node)
    except yaml.YAMLError:
        raise
    except Exception as error:
        # Of a 13th month or `!!bool word` PyYAML raises whatever Python does.
        raise ConfigError(
            f"{where}: YAML cannot read {node.value} as {node.tag.rpartition(':')[2]} ({error}); "
            f'correct it, or write "{node.value}" in quotes if it is a text'
        ) from error
