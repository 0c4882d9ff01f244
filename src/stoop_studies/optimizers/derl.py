"""DERL, differential evolution with random localization: the paper's related work [7].

The base is the best of three random members and the other two make the difference, with a new F for every mutant,
uniform in [-1, -0.4] or [0.4, 1]; CR = 0.5. From memory; the publication was not at hand. Mutants outside the box
are clipped as everywhere here.

References
----------
Kaelo and Ali (2006), A numerical study of some modified differential evolution algorithms, Eur. J. Oper. Res. 169,
1176-1184.
"""

from __future__ import annotations

from stoop_studies.optimizers.pieces.control import Signed
from stoop_studies.optimizers.pieces.evolution import DifferentialEvolution
from stoop_studies.optimizers.pieces.mutation import Localized


def derl() -> DifferentialEvolution:
    """Return DERL."""
    return DifferentialEvolution("derl", Localized(), Signed(0.4, 1.0, rate=0.5))
