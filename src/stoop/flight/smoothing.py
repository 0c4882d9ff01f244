"""Derivatives of sampled signals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
SPAN = 0.11  #: s, of the local parabola


def smooth_derivative(signal: FloatArray, dt: float) -> FloatArray:
    """Differentiate by a local parabola (Savitzky and Golay, Anal. Chem. 36, 1964).

    Parameters
    ----------
    signal : (n,)
    dt : float, s
    """
    from scipy.signal import savgol_filter

    length = max(5, 2 * round(SPAN / dt / 2.0) + 1)
    if len(signal) < length:
        return np.asarray(np.gradient(signal, dt))
    return np.asarray(savgol_filter(signal, length, 2, deriv=1, delta=dt))
