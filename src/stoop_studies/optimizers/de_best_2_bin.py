"""DE/best/2/bin: the paper's eq. (6), second line.

References
----------
Storn (1996), On the usage of differential evolution for function optimization, NAFIPS, 519-523.
"""

from __future__ import annotations

from stoop_studies.optimizers.pieces.control import Fixed
from stoop_studies.optimizers.pieces.evolution import DifferentialEvolution
from stoop_studies.optimizers.pieces.mutation import Best2


def de_best_2_bin() -> DifferentialEvolution:
    """Return DE/best/2/bin with F = 0.5 and CR = 0.9."""
    return DifferentialEvolution("de-best-2-bin", Best2(), Fixed(0.5, 0.9))
