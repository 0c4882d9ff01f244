"""Pages of one file that work offline: sections, tables, plots and time histories."""

from stoop.base.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
