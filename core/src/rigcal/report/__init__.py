"""The report of a calibration: one HTML file that needs nothing else; the picture of a plan."""

from rigcal.report.html import write_report
from rigcal.report.plan_picture import check_picture, write_plan_picture

__all__ = ["check_picture", "write_plan_picture", "write_report"]
