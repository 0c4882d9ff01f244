"""Numbers and lists as a reader wants them, and text of unknown origin made printable."""

from stoop.base.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
