"""The report of a run: one self-contained page, its pictures and tables."""

from tasks.study.report.page import write_report

__all__ = ["write_report"]
