"""Vehicle files: parameters and their numbers, expressions, equations, and what is checked of them.

`Vehicle.with_numbers` and `Vehicle.rows` are the way to change numbers; a vehicle is never changed in place.
"""

from stoop.base.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
