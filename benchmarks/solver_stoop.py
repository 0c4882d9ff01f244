"""stoop: the fit as its user calls it, or its Levenberg-Marquardt method from the start alone, as other tools do it."""

from __future__ import annotations

import numpy as np

from benchmarks.solver_case import Case, Found, Solver
from stoop.base.arrays import FloatArray
from stoop.estimate.fit import Options, estimation_problem, fit
from stoop.optimize import Evaluations, Ledger, refine
from stoop.optimize.local_refinement import FULL
from stoop_studies.verify.scenes import Scene, in_white_noise, sensor_noise


def scene() -> Scene:
    """Return the flights and the wrong start of `benchmarks.joint`."""
    return in_white_noise(0)


def options(given: Scene) -> Options:
    """Return options with the covariance of the noise, so that weights are the same for all tools."""
    return Options(seed=0, covariance=sensor_noise(given.start) ** 2)


def prepare(case: Case, local: bool = False) -> Solver:
    """Take the flights themselves, whose equations are not those of the case but the vehicle's."""
    flown = scene()
    problem, _ = estimation_problem(flown.start, flown.flights, flown.windows, options(flown))

    def simulate(z: FloatArray) -> FloatArray:
        return np.stack([problem.outputs(z, i) for i in range(len(problem.pieces))])

    def fit_whole() -> Found:
        found = fit(flown.start, flown.flights, flown.windows, options(flown))
        return Found(found.z, found.outcome.generation, round(found.trajectories))

    def fit_locally() -> Found:
        ledger = Ledger(problem, Evaluations.none(problem), np.inf)
        end = refine(ledger, case.start, len(problem.prices) - 1, FULL)
        return Found(end.z, end.iterations, round(ledger.spent))

    return Solver(simulate, fit_locally if local else fit_whole)
