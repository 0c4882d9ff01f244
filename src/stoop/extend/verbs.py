"""What a verb of the command line does the same way as all others: options, pages, printed numbers, progress."""

from stoop.base.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
