"""A result as a page: verdict, estimates, curves, and where everything came from."""

from stoop.report.identification import render, render_validation

__all__ = ["render", "render_validation"]
