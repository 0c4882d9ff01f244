"""Robust statistics: a scale that outliers do not reach, and Huber's weights.

References
----------
Huber, "Robust estimation of a location parameter", Ann. Math. Statist. 35 (1964) 73.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray

HUBER: Final = 1.345  #: standard deviations; 95 % efficient on Gaussian noise
MAD: Final = 1.4826  #: median absolute deviation to standard deviation of Gaussian noise


def robust_std(residuals: FloatArray) -> float:
    """Return the standard deviation of residuals (n,) about zero, from their median size."""
    return MAD * float(np.median(np.abs(residuals)))


def white_noise(x: FloatArray) -> float:
    """Return the mean square of the white noise of a column (n,), NaN where unknown: second differences have six times that."""
    apart = np.diff(x, 2)
    known = apart[np.isfinite(apart)]
    return robust_std(known) ** 2 / 6.0 if known.size else 0.0


def huber_weights(residuals: FloatArray, sigma: float) -> FloatArray:
    """Return weights (n,) of squares, 0 to 1, of residuals (n,) of scale `sigma`."""
    return np.asarray(np.minimum(1.0, HUBER * sigma / np.maximum(np.abs(residuals), 1e-12)))
