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
    """Return weighted-centroid mutation with a self-adjusting convergence factor: the paper's related work [1].

    The paper says that the factor builds a self-adjusting weighted centroid and strengthens the local search late in
    a run. It names no author that could be found, and its own reference list points elsewhere, so this is a
    reconstruction from that sentence. Ours are: the centroid of three members weighted by cost; a factor that is one
    minus the population's mean width in the unit box; F = 0.7 and CR = 0.9. Bases that are centroids contract a
    population: with F = 0.6, 3 searches of 20 in the paper's narrow box stagnated, with 0.7 none.
    """
    return DifferentialEvolution("weighted-centroid", to_weighted_centroid, Fixed(0.7, 0.9))


def multi_population() -> DifferentialEvolution:
    """Return differential evolution on two islands, with migration: the paper's related work [2].

    Several populations search side by side, so that a problem with many optima does not draw all members to one
    (Zaharie 2004). Of the many schemes of exchange the ring of Tasoulis et al. (2004) is taken: with a fixed
    probability after each generation, the best of each island replaces a random member of the next. Ours are the
    numbers: the 50 members that every method here has, on two islands, DE/rand/1/bin with F = 0.6 and CR = 0.9 on
    each. Smaller islands, or F = 0.5, stagnate before they converge. Both publications are cited for the idea, from
    memory.
    """
    islands = Islands(2)
    return DifferentialEvolution(
        "multi-population",
        rand_1,
        Fixed(0.6, 0.9),
        structure=islands,
        after_selection=(RingMigration(islands),),
    )


def hybrid() -> DifferentialEvolution:
    """Return hybrid differential evolution, with acceleration and migration: the paper's related work [3].

    Where a generation does not improve the best, the best takes a step down its gradient (acceleration); where the
    population has contracted, all others are drawn anew about the best (migration). Both operations are those of
    Chiou and Wang (1999), from memory. Two things are ours, because a gradient has a unit and a best may lie at zero:
    the first step is as long as the population's mean distance from its best, and two values are the same within a
    width of the box, not of the best's value. The gradient is a forward difference; its evaluations count.
    DE/rand/1/bin with F = 0.5 and CR = 0.9 does the rest.
    """
    operators = (Acceleration(), Migration())
    return DifferentialEvolution("hybrid", rand_1, Fixed(0.5, 0.9), after_selection=operators)


def trigonometric() -> DifferentialEvolution:
    """Return differential evolution with trigonometric mutation: the paper's related work [4].

    The mutation, its probability of 0.05, F = 0.99 and CR = 0.85 are those of Fan and Lampinen (2003); the
    publication was not at hand, but other implementations agree on all four. Trigonometric mutants contract a
    population, so F = 0.5, enough for DE/rand/1/bin, is too little here.
    """
    return DifferentialEvolution("trigonometric", Trigonometric(), Fixed(0.99, 0.85))


def sacpmde() -> DifferentialEvolution:
    """Return SACPMDE, with self-adapting control parameters: the paper's related work [6].

    Of three members the best is the base and the other two the difference, with an F that grows with the distance in
    cost between them; a parent that is better than the mean is crossed over at a low rate, a worse one at a rate
    that grows with its cost. So much is in the abstract of Wu, Wang and Zhou (2007). The formulas, and the ranges F
    from 0.1 to 0.9 and CR from 0.1 to 0.6, are from memory.
    """
    return DifferentialEvolution("sacpmde", ScaledByCost(), ByCost())


def asmde() -> DifferentialEvolution:
    """Return ASMDE, with an adaptive second mutation (Wu et al. 2006): the paper's related work [6].

    What is known is the title, and what the paper says: a second mutation that follows the variance of the
    population's fitness. The publication was not at hand, so the form and all numbers are a reconstruction: where
    the relative variance of the costs falls to 1e-8, which without an optimum at zero is what premature convergence
    looks like, members are moved by Gaussian steps, the more of them the smaller the variance. DE/rand/1/bin with
    F = 0.5 and CR = 0.9 does the rest. Near an optimum of zero cost the relative variance does not fall, and there
    is no second mutation: without noise this is DE/rand/1/bin to the last bit.
    """
    return DifferentialEvolution("asmde", rand_1, Fixed(0.5, 0.9), after_selection=(SecondMutation(),))


def derl() -> DifferentialEvolution:
    """Return DERL, with random localization: the paper's related work [7].

    The base is the best of three random members and the other two make the difference, with a new F for every
    mutant, uniform in [-1, -0.4] or [0.4, 1]; CR = 0.5. From memory of Kaelo and Ali (2006). Mutants outside the box
    are clipped as everywhere here.
    """
    return DifferentialEvolution("derl", localized, Signed(0.4, 1.0, rate=0.5))
