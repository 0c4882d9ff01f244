"""A result as a page: verdict, estimates, curves, and where everything came from."""

from stoop.report.identification import render, write_report, write_validation

__all__ = ["render", "write_report", "write_validation"]
