"""The command line: one file per command."""

from rigcal.cli.app import main

__all__ = ["main"]
