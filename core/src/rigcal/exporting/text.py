"""Files with comments: YAML and XML."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from typing import Any

import yaml


def commented_yaml(lines: Sequence[str], content: Mapping[str, Any]) -> str:
    """A YAML file: lines of comment, then the content with one line per innermost entry."""
    text = yaml.safe_dump(
        dict(content), sort_keys=False, default_flow_style=None, width=1000, allow_unicode=True
    )
    return "".join(f"# {line}\n" for line in lines) + text


def xml_comment(element: ET.Element, lines: Sequence[str]) -> None:
    """Add a comment of several lines; XML allows no two dashes in a row in it."""
    text = "\n".join(f"    {line.replace('--', '- -')}" for line in lines)
    element.append(ET.Comment(f"\n{text}\n  "))


def xml_document(root: ET.Element) -> str:
    """The XML file of an element, indented."""
    ET.indent(root)
    return f'<?xml version="1.0"?>\n{ET.tostring(root, encoding="unicode")}\n'
