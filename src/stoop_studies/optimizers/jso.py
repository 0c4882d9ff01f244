"""jSO: L-SHADE with a weighted step towards the elite and bounds on early scales and rates.

References
----------
Brest, Maucec and Boskovic (2017), Single objective real-parameter optimization: algorithm jSO, IEEE CEC,
1311-1318.
Brest, Maucec and Boskovic (2016), iL-SHADE: improved L-SHADE algorithm for single objective real-parameter
optimization, IEEE CEC, 1188-1195 (the entry fixed at 0.9, and an elite other than the parent at first).
"""

from __future__ import annotations

from math import log, sqrt
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.adaptation import ParameterMemory
from stoop.optimize.operators import elite
from stoop_studies.optimizers.l_shade import FEWEST, LinearShade
from stoop_studies.optimizers.pieces.operators import FIXED, Choice, elite_but_self, learn_halfway

ENTRIES: Final = 5
WIDEST: Final = 0.25  #: share of elite at the start; half of it at the end


def members(dimension: int) -> int:
    """Return the first population's size, 25 ln(D) sqrt(D), rounded."""
    return max(FEWEST, round(25.0 * log(dimension) * sqrt(dimension)))


def first_memory() -> ParameterMemory:
    """Return scales of 0.3 and rates of 0.8, and the last entry that is never learnt."""
    scales, rates = np.full(ENTRIES, 0.3), np.full(ENTRIES, 0.8)
    scales[-1] = rates[-1] = FIXED
    return ParameterMemory(scales, rates, 0)


def limit(scales: FloatArray, rates: FloatArray, progress: float) -> tuple[FloatArray, FloatArray]:
    """Return scales and rates, (n,) each, that are held from extremes at the beginning."""
    if progress < 0.6:
        scales = np.minimum(scales, 0.7)
    least = 0.7 if progress < 0.25 else 0.6 if progress < 0.5 else 0.0
    return scales, np.maximum(rates, least)


def pull(progress: float) -> float:
    """Return the weight of the step towards the elite (the paper's Fw over F)."""
    return 0.7 if progress < 0.2 else 0.8 if progress < 0.4 else 1.2


def choose(progress: float) -> Choice:
    """Return who of the elite: another than the parent in the first half."""
    return elite_but_self if progress < 0.5 else elite


def jso(budget: float | None = None) -> LinearShade:
    """Return jSO, planned over a budget in trajectories (None: 10,000 per variable)."""
    return LinearShade(
        name="jso",
        budget=budget,
        members=members,
        memory=first_memory(),
        learn=learn_halfway,
        limit=limit,
        share=lambda progress: WIDEST * (1.0 - 0.5 * progress),
        pull=pull,
        choose=choose,
        archive=1.0,
    )
