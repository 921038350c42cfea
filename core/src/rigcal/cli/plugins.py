"""`rigcal plugins`: what is installed, and what is broken."""

from __future__ import annotations

from dataclasses import asdict

from rigcal.cli.output import Json, print_json, print_line, print_table

PLUGINS_BRING_MORE = "plugins bring more: `rigcal plugins` lists those that are installed"


def plugins(json: Json = False) -> None:
    """List the installed plugins and what they offer."""
    from rigcal.plugin import CONTRACT_VERSION
    from rigcal.plugin.registry import Registry

    registry = Registry.from_entry_points()
    if json:
        print_json(
            {
                "contract": CONTRACT_VERSION,
                "plugins": [asdict(plugin) for plugin in registry.plugins],
                "broken": [asdict(broken) for broken in registry.broken],
                "sensor_types": sorted(registry.sensor_types),
                "target_types": sorted(registry.target_types),
                "recording_formats": sorted(registry.recording_formats),
                "exporters": sorted(registry.exporters),
                "importers": sorted(registry.importers),
                "commands": sorted(registry.commands),
                "schemas": sorted(registry.schemas),
            }
        )
        return
    rows = [(p.distribution, p.version, p.name, p.offers) for p in registry.plugins]
    print_table("", ("<distribution", "<version", "<plugin", "<offers"), rows)
    for broken in registry.broken:
        print_line(f"broken: {broken}")
