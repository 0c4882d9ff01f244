"""Many independent runs on any executor, into one store, resumed after an interruption."""

from stoop.base.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
