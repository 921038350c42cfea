"""`rigcal schema`: JSON Schema of rig.yaml, for editors."""

from __future__ import annotations

from rigcal.cli.output import print_json


def schema() -> None:
    """Print the JSON Schema of rig.yaml for the installed plugins."""
    from rigcal.plugin.registry import Registry
    from rigcal.rig import rig_schema

    print_json(rig_schema(Registry.from_entry_points()))
