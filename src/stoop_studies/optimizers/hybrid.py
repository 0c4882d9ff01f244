"""Hybrid differential evolution, with acceleration and migration: the paper's related work [3].

Where a generation does not better the best, the best takes a step down its gradient (acceleration); where the
population has drawn together, all others are strewn anew about the best (migration).

Both operations are those of Chiou and Wang (1999), from memory: the publication was not at hand. Two things are
ours, because a gradient has a unit and a best may lie at zero: the first step is as long as the population's mean
distance from its best, and two values are the same within a width of the box, not of the best's value. The
gradient is a forward difference; its evaluations count. DE/rand/1/bin with F = 0.5 and CR = 0.9 does the rest.

References
----------
Chiou and Wang (1999), Hybrid method of evolutionary algorithms for static and dynamic optimization problems with
application to a fed-batch fermentation process, Comput. Chem. Eng. 23, 1277-1291.
"""

from __future__ import annotations

from stoop_studies.optimizers.pieces.acceleration import Acceleration
from stoop_studies.optimizers.pieces.control import Fixed
from stoop_studies.optimizers.pieces.diversity import Migration
from stoop_studies.optimizers.pieces.evolution import DifferentialEvolution
from stoop_studies.optimizers.pieces.mutation import Rand1


def hybrid() -> DifferentialEvolution:
    """Return differential evolution with acceleration and migration."""
    return DifferentialEvolution("hybrid", Rand1(), Fixed(0.5, 0.9), sequels=(Acceleration(), Migration()))
