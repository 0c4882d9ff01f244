"""The differential evolutions: the paper's PS-GDE, its ancestors and the methods that it names as related work.

All are `DifferentialEvolution` with pieces put in; what a docstring does not name is the loop's default. "From
memory" means that the publication was not at hand when the method was written. References to the pieces stand with them,
in `mutation` and `evolution`.

References
----------
Storn and Price (1997), Differential evolution, a simple and efficient heuristic for global optimization over
continuous spaces, J. Global Optim. 11, 341-359.
Storn (1996), On the usage of differential evolution for function optimization, NAFIPS, 519-523.
Zaharie (2004), A multipopulation differential evolution algorithm for multimodal optimization, Mendel, 17-22.
Wu, Wang, Yuan and Zhou (2006), Differential evolution algorithm with adaptive second mutation, Control and Decision 21,
898-902 (in Chinese).
"""

from __future__ import annotations

from typing import Final

from stoop.optimize.population import MEMBERS
from stoop_studies.optimizers.evolution import (
    Acceleration,
    DifferentialEvolution,
    Initialization,
    Islands,
    Migration,
    RingMigration,
    SecondMutation,
    chaos,
)
from stoop_studies.optimizers.local_search import PreySchedule, SteepestDescent
from stoop_studies.optimizers.mutation import (
    ByCost,
    Fixed,
    Mutation,
    ScaledByCost,
    Signed,
    Trigonometric,
    best_2,
    localized,
    ordered,
    rand_1,
)
from stoop_studies.optimizers.mutation import weighted_centroid as to_weighted_centroid

PREY: Final = PreySchedule(SteepestDescent())


def ps_gde(
    mutation: Mutation = ordered,
    initialization: Initialization = chaos,
    prey: PreySchedule | None = PREY,
    scale: float = 0.6,
    rate: float = 0.9,
    members: int = MEMBERS,
) -> DifferentialEvolution:
    """Return the paper's PS-GDE: chaotic start, ordered mutation (eq. 12), steepest descent from the best, its prey.

    What the paper leaves open or prints wrongly is read as follows: local search when NC divides the generation, in
    place of evolution; the gradient by forward differences, which are counted; golden section on [0, 0.1] of the
    unit negative gradient; greedy replacement; F = 0.6, CR = 0.9; clipping at the bounds; 0.05 x 50 prey rounded to 3.

    Parameters
    ----------
    mutation : `unordered` takes the sorting away
    initialization : first population; `uniform` takes the chaos away
    prey : None takes the local search away; ``PreySchedule(SteepestDescent(), swapped=True)`` is it as printed
    scale, rate : F and CR
    members : of the population
    """
    control = Fixed(scale, rate)
    return DifferentialEvolution(
        "ps-gde", mutation, control, initialization=initialization, members=members, prey=prey
    )


def de_rand_1_bin() -> DifferentialEvolution:
    """Return DE/rand/1/bin with F = 0.5 and CR = 0.9, the original (Storn and Price); the paper's eq. (6), first line."""
    return DifferentialEvolution("de-rand-1-bin", rand_1, Fixed(0.5, 0.9))


def de_best_2_bin() -> DifferentialEvolution:
    """Return DE/best/2/bin with F = 0.5 and CR = 0.9 (Storn): the paper's eq. (6), second line."""
    return DifferentialEvolution("de-best-2-bin", best_2, Fixed(0.5, 0.9))


def weighted_centroid() -> DifferentialEvolution:
    """Return weighted-centroid mutation with a self-adjusting convergence factor: the paper's related work [1]."""
    return DifferentialEvolution("weighted-centroid", to_weighted_centroid, Fixed(0.7, 0.9))


def multi_population() -> DifferentialEvolution:
    """Return differential evolution on two islands, with migration: the paper's related work [2]."""
    islands = Islands(2)
    return DifferentialEvolution(
        "multi-population",
        rand_1,
        Fixed(0.6, 0.9),
        structure=islands,
        after_selection=(RingMigration(islands),),
    )


def hybrid() -> DifferentialEvolution:
    """Return hybrid differential evolution, with acceleration and migration: the paper's related work [3]."""
    operators = (Acceleration(), Migration())
    return DifferentialEvolution("hybrid", rand_1, Fixed(0.5, 0.9), after_selection=operators)


def trigonometric() -> DifferentialEvolution:
    """Return differential evolution with trigonometric mutation: the paper's related work [4]."""
    return DifferentialEvolution("trigonometric", Trigonometric(), Fixed(0.99, 0.85))


def sacpmde() -> DifferentialEvolution:
    """Return SACPMDE, with self-adapting control parameters: the paper's related work [6]."""
    return DifferentialEvolution("sacpmde", ScaledByCost(), ByCost())


def asmde() -> DifferentialEvolution:
    """Return ASMDE, with an adaptive second mutation (Wu et al. 2006): the paper's related work [6]."""
    return DifferentialEvolution("asmde", rand_1, Fixed(0.5, 0.9), after_selection=(SecondMutation(),))


def derl() -> DifferentialEvolution:
    """Return DERL, with random localization: the paper's related work [7]."""
    return DifferentialEvolution("derl", localized, Signed(0.4, 1.0, rate=0.5))
