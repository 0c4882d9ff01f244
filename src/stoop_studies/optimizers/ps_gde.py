"""The paper's PS-GDE: chaotic start, ordered mutation (eq. 12), and steepest descent from the best, its prey.

What the paper leaves open or prints wrongly is read as follows: local search when NC divides the generation, in
place of evolution; the gradient by forward differences, which are counted; golden section on [0, 0.1] of the
unit negative gradient; greedy replacement; F = 0.6, CR = 0.9; clipping at the bounds; 0.05 x 50 prey rounded to 3.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.operators import MEMBERS
from stoop_studies.optimizers.pieces.control import Fixed
from stoop_studies.optimizers.pieces.evolution import DifferentialEvolution
from stoop_studies.optimizers.pieces.golden import SteepestDive
from stoop_studies.optimizers.pieces.mutation import Mutation, Ordered
from stoop_studies.optimizers.pieces.operators import chaos
from stoop_studies.optimizers.pieces.prey import PreySchedule

SCALE: Final = 0.6  #: F
RATE: Final = 0.9  #: CR
ORDERED: Final = Ordered()
PREY: Final = PreySchedule(SteepestDive())


def ps_gde(
    mutation: Mutation = ORDERED,
    initialization: Callable[[int, int, np.random.Generator], FloatArray] = chaos,
    prey: PreySchedule | None = PREY,
    scale: float = SCALE,
    rate: float = RATE,
    members: int = MEMBERS,
) -> DifferentialEvolution:
    """Return PS-GDE, or what is left of it when one of its pieces is exchanged.

    Parameters
    ----------
    mutation : Mutation
        `Unordered` takes the sorting away.
    initialization : callable
        First population; `uniform` takes the chaos away.
    prey : PreySchedule, optional
        None takes the local search away; ``PreySchedule(SteepestDive(), swapped=True)`` is it as printed.
    scale, rate : float
        F and CR.
    members : int
        Of the population.
    """
    return DifferentialEvolution(
        "ps-gde",
        mutation,
        Fixed(scale, rate),
        initialization=initialization,
        members=members,
        prey=prey,
    )
