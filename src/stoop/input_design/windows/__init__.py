"""Which windows of a flight to fit: excitation proposes them, information chooses among them, one is held out."""

from stoop.input_design.windows.find import Found, Proposed, doubts, find_windows

__all__ = ["Found", "Proposed", "doubts", "find_windows"]
