"""Types of arrays, runs of samples, robust statistics, and rotations as quaternions.

Quaternions and vectors have their components on the first axis; samples follow.
"""

from stoop.base.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
