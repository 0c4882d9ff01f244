"""SACPMDE, differential evolution with self-adapting control parameters: the paper's related work [6].

Of three members the best is the base and the other two the difference, with an F that grows with the distance in
cost between them; a parent that is better than the mean is crossed over at a low rate, a worse one at a rate that
grows with its cost. So much is in the abstract of Wu, Wang and Zhou (2007). The formulas, and the ranges F from 0.1 to
0.9 and CR from 0.1 to 0.6, are from memory; the publication was not at hand.

References
----------
Wu, Wang and Zhou (2007), Self-adapting control parameters modified differential evolution for trajectory planning
of manipulators, J. Control Theory Appl. 5, 365-373.
"""

from __future__ import annotations

from stoop_studies.optimizers.pieces.control import ByCost
from stoop_studies.optimizers.pieces.evolution import DifferentialEvolution
from stoop_studies.optimizers.pieces.weighing import Graded


def sacpmde() -> DifferentialEvolution:
    """Return SACPMDE."""
    return DifferentialEvolution("sacpmde", Graded(), ByCost())
