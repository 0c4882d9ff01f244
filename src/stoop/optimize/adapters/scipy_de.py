"""SciPy's differential evolution, begun again from a new population whenever it has converged.

References
----------
Storn and Price (1997), J. Global Optim. 11, 341-359; the implementation is `scipy.optimize.differential_evolution`
with its defaults: best1bin, dither 0.5 to 1, crossover 0.7, converged when the standard deviation of the costs is
1 % of their mean, polished by L-BFGS-B then.

Four things are not its defaults: 50 members, as for all others here (SciPy: 15 a variable); as many generations as
convergence takes (1000); a generation is evaluated as a whole, so that its winners take effect in the next one
("deferred"; SciPy: at once); and the first member is where the run is told to begin. Its Latin hypercube is ours.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.adapters.library import Library, finite_costs
from stoop.optimize.ledger import Ledger
from stoop.optimize.pieces.initialization import MEMBERS, latin_hypercube

GENERATIONS: Final = 10**7  #: never reached: it is convergence that ends a run


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
        vectorized=True,
        updating="deferred",
        seed=generator,
    )


def scipy_de() -> Library:
    """Return SciPy's differential evolution."""
    return Library("scipy-de", search)
