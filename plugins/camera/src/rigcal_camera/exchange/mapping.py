"""YAML files that may be of another format."""

from __future__ import annotations

from typing import Any

import yaml


def mapping_in(text: str) -> dict[Any, Any]:
    """The mapping in a YAML text; empty for anything else."""
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError:
        return {}
    return content if isinstance(content, dict) else {}
