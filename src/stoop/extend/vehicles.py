"""Vehicle files: their schema, terms, equations in symbols, and checks; a `Vehicle` is never changed in place."""

from stoop.base.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
