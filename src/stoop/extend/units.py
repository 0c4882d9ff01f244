"""Units as factors to SI, and the standard atmosphere."""

from stoop.base.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
