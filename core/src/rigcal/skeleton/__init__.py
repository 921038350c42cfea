"""A new plugin, written out: a working sensor type to be changed file by file."""

from rigcal.skeleton.write import new_plugin

__all__ = ["new_plugin"]
