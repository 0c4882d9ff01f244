"""The same equations as ordinary Python: what one would write with SciPy, and an independent reference.

The functions are printed from the vehicle's symbols with every number of the aircraft folded in and common
sub-expressions taken out; only states, inputs and the 32 coefficients remain. That is leaner than a
right-hand side written by hand.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import sympy as sp
from scipy.integrate import odeint, solve_ivp

from benchmarks.case import RATE, Case
from stoop.base.arrays import FloatArray
from stoop.vehicle.symbolic import build_model

Function = Callable[[Sequence[float], Sequence[float], Sequence[float]], Sequence[Any]]


@dataclass(frozen=True)
class Plain:
    """Rates and readings as functions of tuples: states, inputs, coefficients."""

    case: Case
    rates: Function
    readings: Function
    coefficients: tuple[float, ...]
    start: FloatArray
    inputs: FloatArray

    @property
    def time(self) -> FloatArray:
        """Sample times, s."""
        return self.case.flown.time


def plain(case: Case) -> Plain:
    """Print the case's equations."""
    model, rows = build_model(case.vehicle), case.rows(1)
    varied = [model.parameters[i] for i in case.coefficients]
    fixed = {s: float(v) for s, v in zip(model.parameters, rows[:, 0], strict=True) if s not in varied}
    arguments = (model.states, model.inputs, varied)

    def printed(expressions: Sequence[Any], library: Any) -> Function:
        folded = tuple(sp.sympify(e).xreplace(fixed) for e in expressions)
        function: Function = sp.lambdify(arguments, folded, modules=library, cse=True)
        return function

    return Plain(
        case,
        printed(model.derivatives, "math"),
        printed(model.outputs, "numpy"),
        tuple(float(v) for v in rows[case.coefficients, 0]),
        case.start(rows)[:, 0],
        case.flown.inputs,
    )


def python_odeint(p: Plain) -> Callable[[], FloatArray]:
    """Return a call of odeint with the right-hand side in lean Python."""
    rates, coefficients, last = p.rates, p.coefficients, len(p.inputs) - 2
    u = [tuple(row) for row in p.inputs.tolist()]

    def side(x: FloatArray, t: float) -> Sequence[float]:
        k = min(int(t * RATE), last)
        f = t * RATE - k
        (a0, a1, a2), (b0, b1, b2) = u[k], u[k + 1]
        now = (a0 + f * (b0 - a0), a1 + f * (b1 - a1), a2 + f * (b2 - a2))
        return rates(x.tolist(), now, coefficients)

    return lambda: np.asarray(odeint(side, p.start, p.time, rtol=1e-6))


def numba_odeint(p: Plain) -> Callable[[], FloatArray]:
    """Return a call of odeint with the same right-hand side compiled by Numba."""
    import numba
    from numba.np.unsafe.ndarray import to_fixed_tuple

    rates, inputs, last = numba.njit(p.rates), p.inputs, len(p.inputs) - 2
    coefficients, states = np.array(p.coefficients), len(p.start)
    count = len(coefficients)

    @numba.njit  # type: ignore[untyped-decorator]
    def side(x: Any, t: Any, c: Any) -> Any:
        k = min(int(t * RATE), last)
        f = t * RATE - k
        a, b = inputs[k], inputs[k + 1]
        now = (a[0] + f * (b[0] - a[0]), a[1] + f * (b[1] - a[1]), a[2] + f * (b[2] - a[2]))
        return np.array(rates(to_fixed_tuple(x, states), now, to_fixed_tuple(c, count)))

    return lambda: np.asarray(odeint(side, p.start, p.time, args=(coefficients,), rtol=1e-6))


def readings(p: Plain, states: FloatArray) -> FloatArray:
    """Return what the instruments read (n, n_y) in the states (n, n_x) at the sample times."""
    columns = p.readings(states.T, p.inputs.T, p.coefficients)  # type: ignore[arg-type]
    return np.stack([np.broadcast_to(c, len(states)) for c in columns], axis=1)


def exact(p: Plain) -> FloatArray:
    """Return the states (n, n_x) by DOP853 at rtol 1e-13, begun anew at each corner of the inputs."""
    bends = np.abs(np.diff(p.inputs, 2, axis=0)).max(axis=1) > 1e-12
    corners = [0, *(np.flatnonzero(bends) + 1).tolist(), len(p.time) - 1]
    out = np.empty((len(p.time), len(p.start)))
    out[0] = p.start
    for a, b in pairwise(corners):
        out[a : b + 1] = _stretch(p, a, b, out[a])
    return out


def _stretch(p: Plain, a: int, b: int, start: FloatArray) -> FloatArray:
    """Integrate from sample a to sample b, between which the inputs are straight lines."""
    t0, u0 = p.time[a], p.inputs[a]
    slope = (p.inputs[b] - u0) / (p.time[b] - t0)

    def side(t: float, x: FloatArray) -> Sequence[float]:
        return p.rates(x.tolist(), (u0 + slope * (t - t0)).tolist(), p.coefficients)

    solution = solve_ivp(
        side, (t0, p.time[b]), start, "DOP853", t_eval=p.time[a : b + 1], rtol=1e-13, atol=1e-13
    )
    if not solution.success or not math.isfinite(solution.y.sum()):
        raise RuntimeError(f"DOP853: {solution.message}")
    return np.asarray(solution.y.T)
