"""The calibration in the file formats of other tools."""

from rigcal.exporting.autoware import AUTOWARE
from rigcal.exporting.export import export, write_export
from rigcal.exporting.exporter import Exported, Exporter
from rigcal.exporting.plain import JSON, MATRICES
from rigcal.exporting.tf import LAUNCH, TF
from rigcal.exporting.urdf import URDF, XACRO

BUILTIN_EXPORTERS: tuple[Exporter, ...] = (JSON, MATRICES, URDF, XACRO, LAUNCH, TF, AUTOWARE)

__all__ = ["BUILTIN_EXPORTERS", "Exported", "Exporter", "export", "write_export"]
