"""The target as a page to print, at true scale."""

from rigcal.printing.page import Page, Text, lay_out
from rigcal.printing.write import write_target_page

__all__ = ["Page", "Text", "lay_out", "write_target_page"]
