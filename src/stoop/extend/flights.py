"""Flights on one grid, their mappings and windows, the maneuvers in them, and frequency responses.

Columns of a `Flight` are SI, in body axes, NaN where nothing was measured.
"""

from stoop.base.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
