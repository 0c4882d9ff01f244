"""What a log holds before a mapping: a `Recording` of `Stream`, in units and clocks of the file, and the forms of files."""

from stoop.base.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
