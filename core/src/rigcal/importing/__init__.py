"""Lenses and poses from the files of other tools."""

from rigcal.importing.importer import Imported, Importer
from rigcal.importing.read import import_file
from rigcal.importing.urdf import URDF_FILE

BUILTIN_IMPORTERS: tuple[Importer, ...] = (URDF_FILE,)

__all__ = ["BUILTIN_IMPORTERS", "Imported", "Importer", "import_file"]
