"""How a vehicle moves: trim, steady flight, linear models and simulated maneuvers, with many conditions at a time as lanes."""

from stoop.base.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
