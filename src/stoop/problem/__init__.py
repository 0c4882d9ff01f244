"""Trajectories against a flight -> residuals; the costs of pieces and priors add."""

from stoop.problem.layout import Layout, Nuisance
from stoop.problem.misfit import Misfit, Piece, on_circle
from stoop.problem.weights import Weights

__all__ = ["Layout", "Misfit", "Nuisance", "Piece", "Weights", "on_circle"]
