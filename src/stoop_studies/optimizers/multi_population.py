"""Multi-population differential evolution: the paper's related work [2].

Several populations search side by side, so that a problem with many optima does not draw all members to one
(Zaharie 2004). Of the many schemes of exchange the ring of Tasoulis et al. (2004) is taken: with a fixed
probability after each generation, the best of each island replaces a random member of the next.

Ours are the numbers: the 50 members that every method here has, on two islands, DE/rand/1/bin with F = 0.6 and
CR = 0.9 on each. Smaller islands, or F = 0.5, stand still before they arrive. Neither publication was at hand; both
are cited for the idea, from memory.

References
----------
Zaharie (2004), A multipopulation differential evolution algorithm for multimodal optimization, Mendel, 17-22.
Tasoulis, Pavlidis, Plagianakos and Vrahatis (2004), Parallel differential evolution, IEEE CEC, 2023-2029.
"""

from __future__ import annotations

from typing import Final

from stoop_studies.optimizers.pieces.control import Fixed
from stoop_studies.optimizers.pieces.evolution import DifferentialEvolution
from stoop_studies.optimizers.pieces.islands import Islands, RingMigration
from stoop_studies.optimizers.pieces.mutation import Rand1

ISLANDS: Final = Islands(2)


def multi_population(islands: Islands = ISLANDS, probability: float = 0.2) -> DifferentialEvolution:
    """Return differential evolution on islands.

    Parameters
    ----------
    islands : Islands
    probability : float
        That there is a migration after a generation.
    """
    return DifferentialEvolution(
        "multi-population",
        Rand1(),
        Fixed(0.6, 0.9),
        structure=islands,
        sequels=(RingMigration(islands, probability),),
    )
