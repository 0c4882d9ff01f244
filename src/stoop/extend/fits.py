"""What a fit asks and answers: the problem and its pieces, estimates, covariance, results.

`Result` and what it holds are stable as a ``result.json`` is; what solves the problem is not.
"""

from stoop.base.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
