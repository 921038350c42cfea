"""Pydantic's validation errors in words: what was found, what was expected, what is near."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

Key = str | int
Problem = tuple[tuple[Key, ...], str]

_MAPPING = "a mapping (`key: value` lines)"
# What YAML calls pydantic's kinds of data.
_IN_YAML = {
    "dict_type": _MAPPING,
    "mapping_type": _MAPPING,
    "model_type": _MAPPING,
    "list_type": "a list",
    "tuple_type": "a list",
}


def explain(
    error: ValidationError, model: type[BaseModel], data: Mapping[str, Any]
) -> list[Problem]:
    """(path in `data`, text) for each error that `model.model_validate(data)` raised."""
    details = error.errors(include_url=False)
    unknown, missing, others = [], [], []
    for detail in details:
        path = _path_in(data, detail["loc"], detail["type"])
        if detail["type"] == "extra_forbidden":
            unknown.append((path, _known_keys(model, detail["loc"][:-1], data)))
        elif detail["type"] == "missing":
            missing.append(path)
        elif detail["type"].startswith("union_tag_") and isinstance(detail.get("input"), dict):
            others.append(_wrong_kind(path, detail))
        else:
            others.append((path, _wrong_value(detail)))
    problems: list[Problem] = []
    for path, known in unknown:
        # A misspelt required key is one mistake, not an unknown key and a missing one.
        absent = [str(m[-1]) for m in missing if m[:-1] == path[:-1]]
        nearest = difflib.get_close_matches(str(path[-1]), [*absent, *known], 1, 0.6)
        if nearest and nearest[0] in absent:
            missing.remove((*path[:-1], nearest[0]))
        guess = f"did you mean '{nearest[0]}'?" if nearest else f"known keys: {', '.join(known)}"
        problems.append((path, f"unknown key, {guess}"))
    problems += [(m[:-1], f"key '{m[-1]}' is missing") for m in missing if isinstance(m[-1], str)]
    lengths = {m[:-1]: m[-1] + 1 for m in missing if isinstance(m[-1], int)}
    problems += [
        (path, f"the list is too short, expected {n} items") for path, n in lengths.items()
    ]
    return problems + others


def nearest_of(name: str, known: list[str]) -> str:
    """`, did you mean 'cam0'? (has: cam0, cam1)`, to follow a name that is not known."""
    nearest = difflib.get_close_matches(name, known, 1)
    guess = f", did you mean '{nearest[0]}'?" if nearest else ""
    return f"{guess} (has: {', '.join(map(str, known))})"


def _wrong_kind(path: tuple[Key, ...], detail: Any) -> Problem:
    """A member of a union is told by the value of one key, which is missing or not known."""
    context = detail["ctx"]
    key = context["discriminator"].strip("'_()")
    if "tag" not in context:
        return path, f"key '{key}' is missing"
    known = [tag.strip("'") for tag in context["expected_tags"].split(", ")]
    return (*path, key), f"no {key} '{context['tag']}'{nearest_of(context['tag'], known)}"


def _wrong_value(detail: Any) -> str:
    text = str(detail["msg"])
    if detail["type"] == "value_error":
        return text.removeprefix("Value error, ")
    if detail["type"] in _IN_YAML:
        text = _IN_YAML[detail["type"]]
    elif text.startswith("Input should be "):
        text = text.removeprefix("Input should be ").split(", unable to")[0]
        text = f"a value {text}" if text.startswith(("greater", "less")) else text
    found = detail.get("input")
    if isinstance(found, (dict, list, tuple)):
        shown = f"a list of {len(found)}" if not isinstance(found, dict) else "a mapping"
    else:
        shown = "nothing" if found is None else repr(found)
    return f"found {shown}, expected {text[0].lower()}{text[1:]}"


def _path_in(data: Any, loc: tuple[Key, ...], kind: str) -> tuple[Key, ...]:
    """The parts of pydantic's location that lead through the data (it adds names of unions)."""
    path: list[Key] = []
    for position, part in enumerate(loc):
        last = position == len(loc) - 1
        try:
            data = data[part]
        except (KeyError, IndexError, TypeError):
            if not (last and kind == "missing"):
                continue
        path.append(part)
    return tuple(path)


def _known_keys(model: type[BaseModel], loc: tuple[Key, ...], data: Any) -> list[str]:
    """Keys that may stand at a location, in the order of their declaration."""
    models = [model]
    for part in loc:
        fields = [m.model_fields[part] for m in models if part in m.model_fields]
        if fields:
            models = [inner for f in fields for inner in _models_in(f.annotation)]
        elif isinstance(part, str):
            models = [m for m in models if _is_called(m, part)] or models
    return list(dict.fromkeys(name for m in models for name in m.model_fields))


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models_in(argument)


def _is_called(model: type[BaseModel], tag: str) -> bool:
    """Whether a part of a location names this member of a union."""
    literals = (get_args(f.annotation) for f in model.model_fields.values())
    return model.__name__ == tag or any(tag in values for values in literals)
