"""Errors of one line, which say what the user can correct; the command line prints them without a traceback."""

from stoop.base.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
