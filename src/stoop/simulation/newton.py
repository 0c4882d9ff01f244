"""Newton's method for many small systems at once, one in each lane."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray, IntArray

STEP: Final = 1e-6  #: of the unknowns, which are scaled to about one
MAX_STEP: Final = 3.0  #: of an unknown in one iteration
HALVINGS: Final = 6  #: of a step that does not lessen the residuals

#: unknowns (m, b) of some lanes (b,) -> residuals (r, b)
Residuals = Callable[[FloatArray, IntArray], FloatArray]


def solve(
    residuals: Residuals, start: FloatArray, tolerance: float, iterations: int = 40
) -> tuple[FloatArray, FloatArray]:
    """Return the unknowns (m, B), and the largest residual (B,) of each lane.

    Steps are least-squares solutions, shortened until the residuals fall. A lane that fails keeps a residual above the
    tolerance (infinite where it is not finite), and does not disturb the others.
    """
    x, lanes = np.array(start, dtype=np.float64), np.arange(start.shape[1])
    with np.errstate(all="ignore"):  # of a vehicle that cannot fly residuals overflow
        value = residuals(x, lanes)
        active = _open(value, tolerance)
        for _ in range(iterations):
            if not active.size:
                break
            here, r = x[:, active], value[:, active]
            columns = [(residuals(here + d, active) - r) / STEP for d in STEP * np.eye(len(x))[:, :, None]]
            step = _least_squares(np.stack(columns, axis=2).transpose(1, 0, 2), -r.T).T
            step *= np.minimum(1.0, MAX_STEP / np.maximum(np.abs(step).max(axis=0), 1e-300))
            size, share = _size(r), np.ones(len(active))
            for halving in range(HALVINGS + 1):
                moved = residuals(here + share * step, active)
                good = _size(moved) < size
                if good.all() or halving == HALVINGS:
                    break
                share = np.where(good, share, 0.5 * share)
            x[:, active[good]] = (here + share * step)[:, good]
            value[:, active[good]] = moved[:, good]
            still = _open(value[:, active], tolerance)
            active = active[np.intersect1d(still, np.flatnonzero(good))]
    error = np.abs(value).max(axis=0)
    return x, np.where(np.isfinite(error), error, np.inf)


def _size(value: FloatArray) -> FloatArray:
    """Return the root of the sum of squares (b,) of each lane."""
    return np.asarray(np.sqrt(np.sum(value * value, axis=0)))


def _open(value: FloatArray, tolerance: float) -> IntArray:
    """Return the lanes that are finite and have not converged."""
    error = np.abs(value).max(axis=0)
    return np.flatnonzero(np.isfinite(error) & (error >= tolerance))


def _least_squares(jacobian: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solutions (b, m) of systems (b, r, m); zero where one is not finite."""
    finite = np.asarray(np.isfinite(jacobian).all(axis=(1, 2))) & np.asarray(np.isfinite(right).all(axis=1))
    safe = np.where(finite[:, None, None], jacobian, 0.0)
    known = np.where(finite[:, None], right, 0.0)
    if jacobian.shape[1] == jacobian.shape[2]:
        try:
            regular = safe + (~finite)[:, None, None] * np.eye(safe.shape[1])
            return np.asarray(np.linalg.solve(regular, known[..., None])[..., 0])
        except np.linalg.LinAlgError:  # one lane is singular
            pass
    return np.asarray((np.linalg.pinv(safe) @ known[..., None])[..., 0])
