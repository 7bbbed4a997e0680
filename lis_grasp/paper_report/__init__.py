"""The report of the paper's experiments: its claims beside ours, figures and tables, one page."""

from lis_grasp.paper_report.page import write_report

__all__ = ["write_report"]
