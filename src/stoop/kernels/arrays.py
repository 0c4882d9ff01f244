"""Arrays as compiled code takes them: of the right shape, writable and contiguous."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray


def matrix(a: FloatArray) -> FloatArray:
    """Return an array as compiled code reads it: writable, C-contiguous doubles."""
    if a.dtype == np.float64 and a.flags.carray:
        return a  # the check of np.require takes ten times as long
    return np.require(a, dtype=np.float64, requirements=["C", "W"])


def fits(name: str, array: NDArray[Any], shape: tuple[int, ...]) -> None:
    """Refuse an array of another shape: compiled code would read beyond its end."""
    if array.shape != shape:
        raise ValueError(f"{name}: shape {array.shape} instead of {shape}")
