"""The fit of a regression: estimates with their covariance, and the simulation that is held against the flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.estimate.fit import SHORT, Fit
from stoop.estimate.noise import noise_variance
from stoop.optimize.ledger import Evaluations, Halt
from stoop.problem import Misfit, Weights
from stoop.problem.prepare import Prepared

DIVERGED = "The estimates cannot be flown: the simulation diverges, so figures and curves are missing."


def regressed_fit(
    problem: Misfit,
    prepared: Prepared,
    values: Mapping[str, float],
    covariance: FloatArray,
    name: str,
    notices: Sequence[Notice] = (),
    white: FloatArray | None = None,
) -> Fit:
    """Return the fit of a method that does not simulate.

    Initial states and sensor biases are found with the estimates held, so that curves and figures show the
    model and not the guess of its start.

    Parameters
    ----------
    problem : Misfit
        As posed, see :func:`stoop.estimate.fit.estimation_problem`.
    prepared : Prepared
    values : mapping
        Estimates by the names of free numbers, SI; a free number that is not among them keeps the file's value.
    covariance : (D, D)
        Of the free parameters in the order of ``problem.layout.parameters``, SI; zero rows for what was not
        estimated.
    name : str
        Of the method.
    notices : sequence of Notice
    white : (D, D), optional
        Likewise, as if residuals were white; none where the method did not look at their color.
    """
    layout = problem.layout
    start = np.array([values.get(p.name, p.value) for p in layout.parameters])
    unit = (start - layout.lower) / layout.width
    z, spent = _with_nuisances(problem, np.concatenate([unit, np.zeros(problem.extra)]))
    cost = float(np.sum(problem.residuals(z[None, :], len(problem.prices) - 1) ** 2))
    if np.isfinite(cost):
        problem = problem.weighted(Weights.of(noise_variance(problem, z)))
        cost = float(np.sum(problem.residuals(z[None, :], len(problem.prices) - 1) ** 2))
    outcome = optimize.Outcome(z, cost, spent, 0, "converged", "", np.empty((0, 2)), None, name)
    diverged = () if np.isfinite(cost) else (notice("untyped-warning", text=DIVERGED),)
    said = (*notices, *diverged)
    whole, plain = (None if c is None else _padded(c, len(z)) for c in (covariance, white))
    return Fit(problem, prepared, z, outcome, cost, spent, said, covariance=whole, white=plain)


def _padded(covariance: FloatArray, size: int) -> FloatArray:
    """Return a covariance (size, size), zero for the nuisances."""
    out = np.zeros((size, size))
    out[: len(covariance), : len(covariance)] = covariance
    return out


def _with_nuisances(problem: Misfit, z: FloatArray) -> tuple[FloatArray, float]:
    """Return the vector with the nuisances that suit it best, and the trajectories it took."""
    held = problem.layout.physical(z[None, :])[0]
    numbers = {p.name: {"value": float(v)} for p, v in zip(problem.layout.parameters, held, strict=True)}
    layout = replace(problem.layout, vehicle=problem.layout.vehicle.with_numbers(numbers), parameters=())
    states = replace(problem, layout=layout)
    if not states.extra:
        return z, 0.0
    ledger = optimize.Ledger(states, Evaluations.none(states), np.inf)
    try:
        end = optimize.refine(ledger, z[problem.dimension :], len(states.prices) - 1, SHORT)
    except (KeyboardInterrupt, Halt):
        return z, ledger.spent
    found = end.z if np.isfinite(end.cost) else z[problem.dimension :]
    return np.concatenate([z[: problem.dimension], found]), ledger.spent
