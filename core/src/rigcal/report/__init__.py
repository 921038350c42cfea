"""The HTML report of a calibration: one self-contained file."""

from rigcal.report.html import write_report

__all__ = ["write_report"]
