"""The Cramer-Rao bound: the least standard deviation that any unbiased estimate can have."""

from __future__ import annotations

import numpy as np

from stoop import optimize
from stoop.assess.covariance import invert, standard_errors
from stoop.base.arrays import FloatArray
from stoop_studies.problems import Posed


def deviations(posed: Posed) -> FloatArray:
    """Return the bound's standard deviations (D,) at the truth of a problem, in physical units.

    Residuals are in units of the noise, so their Jacobian J has the information J'J; nuisances are part of it.

    Raises
    ------
    ValueError
        The truth is not known: a mistake of the caller.
    """
    if posed.truth is None:
        raise ValueError("the bound is taken at the truth, which this problem does not know")
    zero = posed.values(np.zeros(posed.problem.dimension))
    width = posed.values(np.ones(posed.problem.dimension)) - zero
    return width * unit_deviations(posed.problem, (posed.truth - zero) / width)


def unit_deviations(problem: optimize.Problem, x: FloatArray) -> FloatArray:
    """Return the same (D,) at a point (D,) of the unit box, in its units."""
    z, full = np.concatenate([x, np.zeros(problem.extra)]), len(problem.prices) - 1
    J, _ = problem.jacobian(z, full, problem.residuals(z[None], full)[0])
    return standard_errors(invert(J.T @ J).matrix)[: problem.dimension]
