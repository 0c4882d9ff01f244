"""Weighted-centroid mutation with a self-adjusting convergence factor: the paper's related work [1].

The paper says of it that the factor builds a self-adjusting weighted centroid and strengthens the local search
late in a run. It names no author that could be found, and its own reference list points elsewhere, so this is a
reconstruction from that sentence. Ours are: the centroid of three members weighted by cost; a factor that is one
minus the population's mean width in the unit box; F = 0.6, the smallest tenth at which a population of centroids
keeps its variance (2 F^2 + 1/3 >= 1, after Zaharie); CR = 0.9.

References
----------
Zaharie (2002), Critical values for the control parameters of differential evolution algorithms, Mendel, 62-67.
"""

from __future__ import annotations

from stoop.optimize.pieces.control import Fixed
from stoop.optimize.pieces.evolution import DifferentialEvolution
from stoop.optimize.pieces.weighing import WeightedCentroid


def weighted_centroid() -> DifferentialEvolution:
    """Return differential evolution with weighted-centroid mutation."""
    return DifferentialEvolution("weighted-centroid", WeightedCentroid(), Fixed(0.6, 0.9))
