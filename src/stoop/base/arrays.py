"""Array types, and runs of a mask."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from stoop.base.numbers import MAX_NUMBER

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.intp]
BoolArray: TypeAlias = NDArray[np.bool_]
ComplexArray: TypeAlias = NDArray[np.complex128]
Factor: TypeAlias = float | FloatArray  #: one for all parents, or one for each, (n, 1)


def within_range(x: FloatArray, most: float = MAX_NUMBER) -> FloatArray:
    """Return an array with NaN in place of numbers that are implausibly large."""
    large = np.abs(x) > most
    return np.where(large, np.nan, x) if large.any() else x


def runs(mask: BoolArray) -> IntArray:
    """Return first index and index past the last of each run of True, (k, 2); `mask` is (n,)."""
    edges: IntArray = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    return edges.reshape(-1, 2)


def run_slices(mask: BoolArray) -> list[slice]:
    """Return the runs of True as slices; `mask` is (n,)."""
    return [slice(start, stop) for start, stop in runs(mask).tolist()]
