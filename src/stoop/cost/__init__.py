"""Trajectories against a flight -> residuals; the costs of pieces and priors add."""

from stoop.cost.layout import Layout, Nuisance
from stoop.cost.misfit import Misfit, Piece, on_circle
from stoop.cost.weights import Weights

__all__ = ["Layout", "Misfit", "Nuisance", "Piece", "Weights", "on_circle"]
