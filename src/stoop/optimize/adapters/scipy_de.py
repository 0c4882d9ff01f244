"""SciPy's differential evolution, begun again from a new population whenever it has converged.

References
----------
Storn and Price (1997), J. Global Optim. 11, 341-359; the implementation is `scipy.optimize.differential_evolution`
with its defaults (best1bin, dither 0.5 to 1, crossover 0.7, polished by L-BFGS-B), but 50 members, and as many
generations as it takes until their costs differ by less than 1e-8.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from stoop.optimize.adapters.library import Library, finite_costs
from stoop.optimize.arrays import FloatArray
from stoop.optimize.ledger import Ledger
from stoop.optimize.pieces.initialization import MEMBERS, latin_hypercube

GENERATIONS: Final = 10**7  #: never reached: it is convergence that ends a run
SPREAD: Final = 1e-8  #: of the costs over their mean, at which a population has converged


def search(ledger: Ledger, start: FloatArray, generator: np.random.Generator) -> None:
    """Run once; `start` takes the first place of the population."""
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
        tol=SPREAD,
        vectorized=True,
        updating="deferred",
        seed=generator,
    )


def scipy_de() -> Library:
    """Return SciPy's differential evolution."""
    return Library("scipy-de", search)
