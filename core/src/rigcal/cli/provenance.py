"""What a result was made from: versions of programs, names and digests of the input.

Names without their folders, and no time: the same input gives the same bytes anywhere.
"""

from __future__ import annotations

import platform
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rigcal.plugin.registry import Registry
    from rigcal.rig import Rig


def versions(rig: Rig, registry: Registry) -> dict[str, str]:
    """Versions of Python, rigcal and the plugins that a rig uses."""
    used = {f"sensor type {sensor.type}" for sensor in rig.sensors.values()}
    used |= {f"target type {target.type}" for target in rig.targets.values()}
    plugins = [p for p in registry.plugins if used & set(p.offers.split(", "))]
    return {"python": platform.python_version(), **{p.distribution: p.version for p in plugins}}


def identity(path: Path, rig: Rig | None = None) -> dict[str, str]:
    """Name and SHA-256 of a file, or of what a rig reads in a folder."""
    from rigcal.recording.fingerprint import fingerprint

    sources = [sensor.source for sensor in rig.sensors.values()] if rig else []
    return {"name": path.resolve().name, "sha256": fingerprint(path, sources)}
