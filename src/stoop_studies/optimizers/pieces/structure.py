"""How large a population is, and who stays when it shrinks.

References
----------
Tanabe and Fukunaga (2014), Improving the search performance of SHADE using linear population size reduction,
IEEE CEC, 1658-1665.
"""

from __future__ import annotations

import numpy as np

from stoop.base.arrays import FloatArray


def linear_size(first: int, last: int, progress: float) -> int:
    """Return the size on the straight line from `first` to `last` as progress goes from 0 to 1."""
    return round(first + (last - first) * min(max(progress, 0.0), 1.0))


def keep_best(X: FloatArray, F: FloatArray, number: int) -> tuple[FloatArray, FloatArray]:
    """Return the `number` cheapest members, (number, D), and their costs; the order stays as it was."""
    if number >= len(F):
        return X, F
    kept = np.sort(np.argsort(F, kind="stable")[:number])
    return X[kept], F[kept]
