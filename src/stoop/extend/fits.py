"""What a fit asks and answers: problems and their pieces, estimates, error bars, and the `Result` of a ``result.json``."""

from stoop.base.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
