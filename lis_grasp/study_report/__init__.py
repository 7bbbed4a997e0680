"""The report of a study: who holds more, what a surface's errors cost, every loss; one page."""

from lis_grasp.study_report.page import write_report
from lis_grasp.study_report.tables import write_tables

__all__ = ["write_report", "write_tables"]
