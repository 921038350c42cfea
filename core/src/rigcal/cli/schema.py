"""`rigcal schema`: JSON Schema of rig.yaml and of other files, for editors."""

from __future__ import annotations

from typing import Annotated

import typer

from rigcal.cli.output import print_json
from rigcal.cli.plugins import PLUGINS_BRING_MORE


def schema(
    file: Annotated[
        str, typer.Argument(metavar="[FILE]", help="rig, or what a plugin adds: scenario.")
    ] = "rig",
) -> None:
    """Print the JSON Schema of rig.yaml, or of another file, for the installed plugins."""
    from rigcal.errors import ConfigError
    from rigcal.plugin.registry import Registry
    from rigcal.rig import rig_schema
    from rigcal.validation import nearest_of

    registry = Registry.from_entry_points()
    schemas = {**registry.schemas, "rig": rig_schema}
    if file not in schemas:
        known = nearest_of(file, sorted(schemas))
        raise ConfigError(f"no schema of '{file}'{known}; {PLUGINS_BRING_MORE}")
    print_json(schemas[file](registry))
