"""Differential evolution with trigonometric mutation: the paper's related work [4].

The mutation, its probability of 0.05, F = 0.99 and CR = 0.85 are those of Fan and Lampinen (2003); the publication
was not at hand, but other implementations agree on all four. Trigonometric mutants draw a population together, so
F = 0.5, enough for DE/rand/1/bin, is too little here.

References
----------
Fan and Lampinen (2003), A trigonometric mutation operation to differential evolution, J. Global Optim. 27,
105-129.
"""

from __future__ import annotations

from stoop_studies.optimizers.pieces.control import Fixed
from stoop_studies.optimizers.pieces.evolution import DifferentialEvolution
from stoop_studies.optimizers.pieces.weighing import Trigonometric


def trigonometric() -> DifferentialEvolution:
    """Return differential evolution with trigonometric mutation."""
    return DifferentialEvolution("trigonometric", Trigonometric(), Fixed(0.99, 0.85))
