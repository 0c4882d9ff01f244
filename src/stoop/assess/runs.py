"""Curves in pieces: segments joined with one NaN between them, and their zero-phase low-pass."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.signal import butter, sosfiltfilt

FloatArray = npt.NDArray[np.float64]

CUTOFF: Final = 10.0  #: Hz; above it there is no rigid-body motion worth matching, only vibration
ORDER: Final = 4  #: of the Butterworth filter, which runs forward and backward


def join(pieces: Sequence[npt.ArrayLike]) -> FloatArray:
    """Return the pieces (n_i,) as one curve, a NaN between neighbors, so that a plot breaks there."""
    parts: list[FloatArray] = []
    for piece in pieces:
        parts += [np.full(1, np.nan), np.asarray(piece, dtype=np.float64)]
    return np.concatenate(parts[1:]) if parts else np.empty(0)


def runs(present: npt.NDArray[np.bool_]) -> Iterator[slice]:
    """Yield the maximal stretches of True of `present` (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], present, [False]])))
    for start, stop in edges.reshape(-1, 2):
        yield slice(int(start), int(stop))


def low_pass(values: FloatArray, rate: float, cutoff: float = CUTOFF) -> FloatArray:
    """Return `values` (n,) without what lies above `cutoff`, without phase shift, each stretch for itself.

    Parameters
    ----------
    values : (n,)
        Uniform samples; NaN separates the stretches and stays.
    rate : float, Hz
        Sample rate. At or below twice the cutoff there is nothing to remove.
    cutoff : float, Hz
        Where the two passes together have lost 6 dB.
    """
    filtered = np.array(values, dtype=np.float64)
    if rate <= 2.0 * cutoff:
        return filtered
    sections = butter(ORDER, cutoff, fs=rate, output="sos")
    natural = 3 * (2 * len(sections) + 1)
    for run in runs(np.isfinite(filtered)):
        # The filter starts on a reflection of the data; a stretch shorter than that reflects what it has.
        padding = min(natural, run.stop - run.start - 1)
        filtered[run] = sosfiltfilt(sections, filtered[run], padlen=padding)
    return filtered
