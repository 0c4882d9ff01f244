"""Which windows of a flight to fit: excitation proposes them, information chooses among them, one is held out."""

from stoop.design.windows.find import Found, Proposed, find_windows

__all__ = ["Found", "Proposed", "find_windows"]
