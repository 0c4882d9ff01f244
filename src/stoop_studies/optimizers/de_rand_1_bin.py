"""DE/rand/1/bin: differential evolution as it began, and the paper's eq. (6), first line.

References
----------
Storn and Price (1997), Differential evolution, a simple and efficient heuristic for global optimization over
continuous spaces, J. Global Optim. 11, 341-359.
"""

from __future__ import annotations

from stoop_studies.optimizers.pieces.control import Fixed
from stoop_studies.optimizers.pieces.evolution import DifferentialEvolution
from stoop_studies.optimizers.pieces.mutation import Rand1


def de_rand_1_bin() -> DifferentialEvolution:
    """Return DE/rand/1/bin with F = 0.5 and CR = 0.9."""
    return DifferentialEvolution("de-rand-1-bin", Rand1(), Fixed(0.5, 0.9))
