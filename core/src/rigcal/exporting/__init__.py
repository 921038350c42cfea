"""The calibration in the file formats of other tools."""

from rigcal.exporting.export import export, write_export
from rigcal.exporting.exporter import Exported, Exporter
from rigcal.exporting.plain import JSON, MATRICES

BUILTIN_EXPORTERS: tuple[Exporter, ...] = (JSON, MATRICES)

__all__ = ["BUILTIN_EXPORTERS", "Exported", "Exporter", "export", "write_export"]
