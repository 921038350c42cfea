"""Docstrings that list fields in columns become lists on the site."""

from __future__ import annotations

import re
from typing import Any

import griffe

_ENTRY = re.compile(r"^(\w+(?:, \w+)*) {2,}(\S.*)$")


class Columns(griffe.Extension):
    """Rewrites paragraphs of `name    text` lines, text going on in indented lines."""

    def on_object(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        """Of every object that has a docstring."""
        if obj.docstring is not None:
            obj.docstring.value = with_lists(obj.docstring.value)


def with_lists(text: str) -> str:
    """The text with each paragraph of columns as a list of Markdown."""
    return "\n\n".join(_as_list(paragraph) for paragraph in text.split("\n\n"))


def _as_list(paragraph: str) -> str:
    lines = paragraph.split("\n")
    if not _ENTRY.match(lines[0]):
        return paragraph
    items: list[str] = []
    for line in lines:
        if entry := _ENTRY.match(line):
            items.append(f"- `{entry[1]}`: {entry[2]}")
        elif line.startswith(" "):
            items.append(f"    {line.strip()}")
        else:
            return paragraph
    return "\n".join(items)
