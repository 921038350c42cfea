"""Reads a file of another tool through the importers of the installed plugins."""

from __future__ import annotations

from pathlib import Path

from rigcal.errors import ConfigError, PluginError, RigcalError
from rigcal.importing.importer import Imported
from rigcal.plugin.registry import Registry


def import_file(path: Path | str, registry: Registry) -> Imported:
    """What a file says of sensors and frames; its format is told by what it holds.

    ConfigError for a file that cannot be read, or of no known format; PluginError for an importer
    that fails.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise ConfigError(f"{path}: cannot be read: {reason}") from error
    for name, importer in registry.importers.items():
        try:
            found = importer.read(text, path.stem)
        except RigcalError as error:
            raise ConfigError(f"{path}: {error}") from error
        except (Exception, SystemExit) as error:
            raise PluginError(
                f"importer '{name}' failed on {path} with {type(error).__name__}: {error}"
            ) from error
        if found is not None:
            return found
    known = ", ".join(sorted(registry.importers))
    raise ConfigError(f"{path}: it is of no format that can be imported (known: {known})")
