"""What people look at: the report (one HTML file), a plan's picture, the time line of a viewer."""

from rigcal.report.html import write_report
from rigcal.report.plan_picture import check_picture, write_plan_picture
from rigcal.report.timeline import show_timeline, write_timeline

__all__ = [
    "check_picture",
    "show_timeline",
    "write_plan_picture",
    "write_report",
    "write_timeline",
]
