"""The registry of variables with units, their families, and the channels of autopilots."""

from stoop.base.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
