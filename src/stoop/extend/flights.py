"""Flights on one grid in SI and body axes, their mappings, windows and maneuvers, and frequency responses."""

from stoop.base.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
