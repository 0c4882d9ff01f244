"""The equations of a vehicle as functions of arrays, without the compiler: for many points and few evaluations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.kernels.kernel import array_functions
from stoop.vehicle.vehicle import Vehicle

Equations = Callable[[FloatArray, FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


def array_equations(vehicle: Vehicle) -> Equations:
    """Return what takes parameters, states and inputs to derivatives and readings.

    Shapes are (n_p,) or (n_p, n), (n_x, n), (n_u, n), (n_x, n), (n_y, n), as of :meth:`stoop.kernels.Kernel.evaluate`.
    """

    def build() -> Any:
        from stoop.vehicle.symbolic import build_model

        return build_model(vehicle)

    functions, count = array_functions(vehicle.structure, build), len(vehicle.states)

    def evaluate(rows: FloatArray, states: FloatArray, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        constants = functions.prepare(rows.tolist() if rows.ndim == 1 else rows)
        found = functions.observe(states, inputs, constants)
        values = np.empty((len(found), *states.shape[1:]))
        for i, value in enumerate(found):
            values[i] = value
        return values[:count], values[count:]

    return evaluate
