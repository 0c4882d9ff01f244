"""The equations of a vehicle as functions of arrays, without the compiler: for many points and few evaluations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import sympy as sp

from stoop.base.arrays import FloatArray
from stoop.vehicle.symbolic import build_model
from stoop.vehicle.vehicle import Vehicle

Equations = Callable[[FloatArray, FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


def array_equations(vehicle: Vehicle) -> Equations:
    """Return what takes parameters, states and inputs to derivatives and readings.

    Shapes are (n_p,) or (n_p, n), (n_x, n), (n_u, n), (n_x, n), (n_y, n), as of :meth:`stoop.kernels.Kernel.evaluate`.
    """
    model = build_model(vehicle)
    symbols = [*model.states, *model.inputs, *model.parameters]
    expressions = [*model.derivatives, *model.outputs]
    function = sp.lambdify(symbols, expressions, "numpy", cse=_common_parts)
    count = len(model.derivatives)

    def evaluate(rows: FloatArray, states: FloatArray, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        found = function(*states, *inputs, *(rows.tolist() if rows.ndim == 1 else rows))
        values = np.empty((len(expressions), *states.shape[1:]))
        for i, value in enumerate(found):
            values[i] = value
        return values[:count], values[count:]

    return evaluate


def _common_parts(expressions: list[Any]) -> tuple[list[tuple[Any, Any]], list[Any]]:
    """Return common parts and what is left, in no order: to sort long expressions takes a minute."""
    return sp.cse(expressions, order="none", list=False)  # type: ignore[no-any-return]
