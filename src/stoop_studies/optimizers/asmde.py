"""ASMDE, differential evolution with an adaptive second mutation: the paper's related work [6].

What is known is the title, and what the paper says: a second mutation that follows the variance of the
population's fitness. The publication was not at hand, so the form and all numbers are a reconstruction: where the
costs have drawn together to a relative variance of 1e-8, which without an optimum at zero is what premature
convergence looks like, members are moved by Gaussian steps, the more of them the smaller the variance. DE/rand/1/bin
with F = 0.5 and CR = 0.9 does the rest. Near an optimum of zero cost the relative variance does not fall, and the
second mutation never wakes.

References
----------
Wu, Wang, Yuan and Zhou (2006), Differential evolution algorithm with adaptive second mutation, Control and
Decision 21, 898-902 (in Chinese).
"""

from __future__ import annotations

from stoop_studies.optimizers.pieces.control import Fixed
from stoop_studies.optimizers.pieces.diversity import SecondMutation
from stoop_studies.optimizers.pieces.evolution import DifferentialEvolution
from stoop_studies.optimizers.pieces.mutation import Rand1


def asmde() -> DifferentialEvolution:
    """Return ASMDE as reconstructed."""
    return DifferentialEvolution("asmde", Rand1(), Fixed(0.5, 0.9), sequels=(SecondMutation(),))
