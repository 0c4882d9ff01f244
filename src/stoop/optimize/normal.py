"""Normal equations of tall, thin least squares, rounded the same for any number of BLAS threads."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from stoop.optimize.arrays import FloatArray

SINGLE: Final = (
    200_000  #: products up to this many multiplications run on one BLAS thread (OpenBLAS: 262,144)
)
STRETCH: Final = 2048  #: of the long axis, over which it is seen which variables have a part


def gram(rows: FloatArray) -> FloatArray:
    """Return rows @ rows.T, (v, v), of rows (v, n), n much larger than v.

    The long axis is cut into slices so small that BLAS does each on one thread, and the slices are added in
    order: the sum does not depend on how many threads there are. Variables without a part in a stretch of the
    long axis (the initial states of another maneuver) are left out there.
    """
    v, n = rows.shape
    stretches = [rows[:, start : start + STRETCH] for start in range(0, n, STRETCH)]
    present = [np.flatnonzero(stretch.any(axis=1)) for stretch in stretches]
    if all(len(some) == v for some in present):
        total = _sliced(rows)
    else:
        total = np.zeros((v, v))
        for stretch, some in zip(stretches, present, strict=True):
            total[np.ix_(some, some)] += _sliced(stretch[some])
    return 0.5 * (total + total.T)


def _sliced(rows: FloatArray) -> FloatArray:
    v, n = rows.shape
    width = max(8, SINGLE // max(1, v * v))
    total = np.zeros((v, v))
    for start in range(0, n, width):
        part = rows[:, start : start + width]
        total += part @ part.T
    return total


def project(rows: FloatArray, r: FloatArray) -> FloatArray:
    """Return rows @ r, summed without BLAS: a threaded product rounds by the number of threads."""
    product: FloatArray = np.einsum("vn,n->v", rows, r)
    return product


def solve_damped(normal: FloatArray, right: FloatArray, damping: float) -> FloatArray:
    """Solve (A + damping diag A) x = b, scaled to a unit diagonal, so that units do not matter.

    A variable that nothing depends on (zero diagonal) stays where it is.
    """
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-24 * max(float(np.diag(normal).max()), 1e-276)))
    unit = normal / np.outer(scale, scale)
    unit[np.diag_indices_from(unit)] += damping
    try:
        x = cho_solve(cho_factor(unit), right / scale)
    except LinAlgError:
        x = np.linalg.lstsq(unit, right / scale, rcond=None)[0]
    solution: FloatArray = np.asarray(x) / scale
    return solution
