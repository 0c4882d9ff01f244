"""Delays: signals read a fraction of a sample late.

A gather inside the kernel would break its vectorization and a linear interpolation would put kinks into the
gradient, so signals are shifted outside it, by four-point Lagrange interpolation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def delayed(signal: FloatArray, samples: float) -> FloatArray:
    """Return a signal as it was ``samples`` earlier; before the record it holds its first value.

    Parameters
    ----------
    signal : (n, ...) array
    samples : float
        Delay in samples; negative looks ahead.
    """
    if samples == 0.0:
        return signal
    whole = int(np.floor(samples))
    fraction = samples - whole
    weights = _lagrange(fraction)
    index = np.arange(len(signal)) - whole
    last = len(signal) - 1
    out = np.zeros_like(signal, dtype=float)
    for offset, weight in zip((1, 0, -1, -2), weights, strict=True):
        out += weight * signal[np.clip(index + offset, 0, last)]
    return out


def _lagrange(f: float) -> tuple[float, float, float, float]:
    """Return the weights of the samples at +1, 0, -1, -2 for the point at -f, 0 <= f < 1."""
    return (
        -f * (1.0 - f) * (2.0 - f) / 6.0,
        (1.0 + f) * (1.0 - f) * (2.0 - f) / 2.0,
        (1.0 + f) * f * (2.0 - f) / 2.0,
        -(1.0 + f) * f * (1.0 - f) / 6.0,
    )


def delayed_lanes(signal: FloatArray, samples: FloatArray) -> FloatArray:
    """Return one delayed copy per lane: (n, B) for a signal (n,), delays (B,).

    Few lanes differ from the first (a Jacobian perturbs one delay at a time), so each distinct delay is
    computed once.
    """
    distinct, lane = np.unique(samples, return_inverse=True)
    copies = np.stack([delayed(signal, float(d)) for d in distinct], axis=-1)
    return np.ascontiguousarray(copies[:, lane])
