"""SciPy's differential evolution, and its least squares from one random start after another.

Differential evolution starts again from a new population whenever it has converged. Four settings are not SciPy's
defaults (best1bin, dither 0.5 to 1, crossover 0.7, converged when the standard deviation of the costs is 1 % of their
mean, polished by L-BFGS-B then): 50 members, as for all others here (SciPy: 15 a variable); as many generations as
convergence takes (1000); a generation is evaluated as a whole, so that its winners take effect in the next one
("deferred"; SciPy: at once); and the first member is the given start. Its Latin hypercube is ours.

Least squares is trust region reflective. Differences count as everybody's: a Jacobian costs one trajectory per
variable. Two settings are ours. A start is given up after 20 trial steps (SciPy: 100 per variable), because most starts
that have not converged by then never do. 20 is the best compromise for SciPy on seeds 0 to 59 of the paper's problem:
expected evaluations on N, W, N+noise, W+noise and N+few+noise are 98, 1614, 108, 1643 and 157 with 40 steps, 94, 1127,
104, 1196 and 161 with 20, and 93, 1092, 103, 1127 and 335 with 15; 1000 steps take more than 20 on each. And
tolerances are as small as rounding allows, since the target ends a run.

References
----------
Storn and Price (1997), J. Global Optim. 11, 341-359; `scipy.optimize.differential_evolution`.
Branch, Coleman and Li (1999), A subspace, interior, and conjugate gradient method for large-scale
bound-constrained minimization problems, SIAM J. Sci. Comput. 21, 1-23; `scipy.optimize.least_squares`.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.ledger import HUGE, Ledger
from stoop.optimize.libraries import Library, finite_costs
from stoop.optimize.operators import MEMBERS, latin_hypercube

GENERATIONS: Final = 10**7  #: never reached: convergence ends a run
STEPS: Final = 20  #: trial steps from one start: the best for SciPy of those tried
INSIDE: Final = 1e-10  #: SciPy starts strictly inside the box


def differential_evolution_run(ledger: Ledger, start: FloatArray, generator: np.random.Generator) -> None:
    """Run differential evolution once; `start` takes the first place of the population."""
    from scipy.optimize import differential_evolution

    def cost(x: FloatArray) -> Any:
        # (D, n) from the population, (D,) from the polishing
        values = finite_costs(ledger, np.atleast_2d(x.T))
        return values if x.ndim == 2 else values[0]

    population = latin_hypercube(MEMBERS, ledger.dimension, generator)
    population[0] = start
    evolve: Any = differential_evolution  # the stubs know no vectorized cost
    evolve(
        cost,
        [(0.0, 1.0)] * ledger.dimension,
        init=population,
        maxiter=GENERATIONS,
        vectorized=True,
        updating="deferred",
        seed=generator,
    )


def scipy_de() -> Library:
    """Return SciPy's differential evolution."""
    return Library("scipy-de", differential_evolution_run)


class _Diverged(Exception):  # noqa: N818 - not an error: this start leads nowhere
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
            raise _Diverged
        self.z, self.r = z.copy(), r
        return r

    def jacobian(self, z: FloatArray) -> FloatArray:
        """Return the Jacobian, (n_r, D + E), at z."""
        r = self.r if np.array_equal(z, self.z) else self.value(z)
        J = self.ledger.jacobian(z, self.ledger.full, r)[0]
        if not (np.abs(J) < HUGE).all():
            raise _Diverged
        return J


def least_squares_run(ledger: Ledger, start: FloatArray, generator: np.random.Generator) -> None:
    """Run least squares once, with the nuisances at zero at the start; a start that diverges is abandoned."""
    from scipy.optimize import least_squares

    residuals = _Residuals(ledger)
    wide = np.full(ledger.extra, np.inf)
    low = np.concatenate([np.zeros(ledger.dimension), -wide])
    high = np.concatenate([np.ones(ledger.dimension), wide])
    z = np.concatenate([np.clip(start, INSIDE, 1.0 - INSIDE), np.zeros(ledger.extra)])
    with suppress(_Diverged, np.linalg.LinAlgError):
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
    return Library("scipy-least-squares", least_squares_run)
