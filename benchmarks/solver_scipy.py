"""SciPy: ``least_squares`` with its own differences on residuals that Numba compiled, Runge-Kutta loop included."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from scipy.optimize import least_squares

from benchmarks.solver_case import Case, Found, Solver
from stoop.base.arrays import FloatArray


def prepare(case: Case) -> Solver:
    """Compile the simulation of all maneuvers; `least_squares` differentiates it column by column."""
    march, shape = _march(case), case.measured.shape

    def simulate(z: FloatArray) -> FloatArray:
        out = np.empty(shape)
        march(case.numbers(z), case.inputs, case.dt, out)
        return out

    def residuals(z: FloatArray) -> FloatArray:
        misfit = (simulate(z) - case.measured) / case.sigma
        return np.concatenate([misfit.ravel(), z[case.coefficients :]])

    def fit() -> Found:
        end = least_squares(residuals, case.start, method="trf", x_scale="jac", jac="2-point")
        return Found(end.x, end.njev, end.nfev + end.njev * len(end.x))

    return Solver(simulate, fit)


def _march(case: Case) -> Any:
    states = len(case.rates)
    rates, readings, beginning = (
        numba.njit(case.printed(e, "math")) for e in (case.rates, case.readings, case.beginning)
    )

    @numba.njit  # type: ignore[untyped-decorator]
    def slopes(x: Any, u: Any, q: Any, out: Any) -> None:
        for i, value in enumerate(rates(x, u, q)):
            out[i] = value

    @numba.njit  # type: ignore[untyped-decorator]
    def march(numbers: Any, inputs: Any, dt: float, out: Any) -> None:
        k1, k2, k3, k4 = np.empty((4, states))
        for w in range(len(numbers)):
            q, x = numbers[w], np.empty(states)
            for i, value in enumerate(beginning(x, inputs[w, 0], q)):
                x[i] = value
            for k in range(out.shape[1]):
                u = inputs[w, k]
                for i, value in enumerate(readings(x, u, q)):
                    out[w, k, i] = value
                if k + 1 < out.shape[1]:
                    end = inputs[w, k + 1]
                    middle = 0.5 * (u + end)
                    slopes(x, u, q, k1)
                    slopes(x + 0.5 * dt * k1, middle, q, k2)
                    slopes(x + 0.5 * dt * k2, middle, q, k3)
                    slopes(x + dt * k3, end, q, k4)
                    x += dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)

    return march
