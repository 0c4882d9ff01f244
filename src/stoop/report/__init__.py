"""A result as a page that people read: verdict, estimates, curves, and where everything came from."""

from stoop.report.page import render, write_report, write_validation

__all__ = ["render", "write_report", "write_validation"]
