"""CMA-ES with BIPOP restarts, from the package ``cma``.

References
----------
Hansen and Ostermeier (2001), Completely derandomized self-adaptation in evolution strategies, Evolutionary
Computation 9, 159-195.
Hansen (2009), Benchmarking a BI-population CMA-ES on the BBOB-2009 function testbed, GECCO, 2389-2395.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.errors import IdentificationError
from stoop.optimize.ledger import Ledger
from stoop.optimize.libraries import Library, draw_seed, finite_costs, require

WIDTH: Final = 0.3  #: first standard deviation, of the box
RESTARTS: Final = 9  #: with a larger population, as BIPOP is usually run; those with a small one do not count
SILENT: Final[dict[str, Any]] = {"verbose": -10, "verb_log": 0, "verb_disp": 0, "signals_filename": None}


def search(ledger: Ledger, start: FloatArray, generator: np.random.Generator) -> None:
    """Run once: `start` is the first mean, later means lie anywhere."""
    if ledger.dimension < 2:
        raise IdentificationError("optimizer cma: cannot search one variable alone; take another optimizer")
    means = [start]

    def mean() -> FloatArray:
        return means.pop() if means else generator.random(ledger.dimension)

    def costs(points: list[FloatArray]) -> list[float]:
        values: list[float] = finite_costs(ledger, np.array(points)).tolist()
        return values

    require("cma").fmin2(
        None,
        mean,
        WIDTH,
        {"bounds": [0.0, 1.0], "seed": draw_seed(generator), **SILENT},
        parallel_objective=costs,
        restarts=RESTARTS,
        bipop=True,
    )


def cma() -> Library:
    """Return BIPOP-CMA-ES.

    Raises
    ------
    IdentificationError
        The package is not installed.
    """
    require("cma")
    return Library("cma", search)
