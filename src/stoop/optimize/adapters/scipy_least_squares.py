"""SciPy's least squares (trust region reflective) from one random start after another.

Differences are booked as everybody's: a Jacobian costs one trajectory per variable.

Two things are ours. A start is given up after 20 trial steps (SciPy: 100 per variable), because most starts that
have not arrived by then never do. 20 is the best compromise for SciPy on seeds 0 to 59 of the paper's problem:
expected evaluations on N, W, N+noise, W+noise and N+few+noise are 98, 1614, 108, 1643 and 157 with 40 steps, 94, 1127,
104, 1196 and 161 with 20, and 93, 1092, 103, 1127 and 335 with 15; 1000 steps take more than 20 on each. And
tolerances are as small as rounding allows, since it is the target that ends a run.

References
----------
Branch, Coleman and Li (1999), A subspace, interior, and conjugate gradient method for large-scale
bound-constrained minimization problems, SIAM J. Sci. Comput. 21, 1-23; the implementation is
`scipy.optimize.least_squares`.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.adapters.library import Library
from stoop.optimize.ledger import HUGE, Ledger

STEPS: Final = 20  #: trial steps from one start: the best for SciPy of those tried
INSIDE: Final = 1e-10  #: SciPy begins strictly inside the box


class _Lost(Exception):  # noqa: N818 - not an error: this start leads nowhere
    """The start diverged."""


class _Residuals:
    """Residuals and Jacobian, each place simulated once."""

    def __init__(self, ledger: Ledger) -> None:
        self.ledger = ledger
        self.z = np.empty(0)
        self.r = np.empty(0)

    def value(self, z: FloatArray) -> FloatArray:
        """Return the residuals, (n_r,), at z, (D + E,)."""
        r: FloatArray = self.ledger.residuals(z[None, :], self.ledger.full)[0]
        if not self.r.size and not (np.abs(r) < HUGE).all():
            raise _Lost
        self.z, self.r = z.copy(), r
        return r

    def jacobian(self, z: FloatArray) -> FloatArray:
        """Return the Jacobian, (n_r, D + E), at z."""
        r = self.r if np.array_equal(z, self.z) else self.value(z)
        J = self.ledger.jacobian(z, self.ledger.full, r)[0]
        if not (np.abs(J) < HUGE).all():
            raise _Lost
        return J


def search(ledger: Ledger, start: FloatArray, generator: np.random.Generator) -> None:
    """Run once from the start, with the nuisances at zero there; a start that diverges is abandoned."""
    from scipy.optimize import least_squares

    residuals = _Residuals(ledger)
    wide = np.full(ledger.extra, np.inf)
    low = np.concatenate([np.zeros(ledger.dimension), -wide])
    high = np.concatenate([np.ones(ledger.dimension), wide])
    z = np.concatenate([np.clip(start, INSIDE, 1.0 - INSIDE), np.zeros(ledger.extra)])
    with suppress(_Lost, np.linalg.LinAlgError):
        least_squares(
            residuals.value,
            z,
            jac=residuals.jacobian,
            bounds=(low, high),
            xtol=1e-12,
            ftol=1e-12,
            gtol=1e-14,
            max_nfev=STEPS,
        )


def scipy_least_squares() -> Library:
    """Return SciPy's least squares with many starts."""
    return Library("scipy-least-squares", search)
