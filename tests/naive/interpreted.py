"""A vehicle's equations without the compiler: SymPy's own translation to NumPy, one point at a time or many."""

from collections.abc import Callable

import numpy as np
import sympy as sp

from stoop.vehicle import Vehicle
from stoop.vehicle.symbolic import build_model

Evaluate = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def interpreted(vehicle: Vehicle) -> Evaluate:
    """Return what takes parameters (n_p, B), states (n_x, B), inputs (n_u, B) to derivatives and readings."""
    m = build_model(vehicle)

    def shared(_: object) -> tuple[list[tuple[sp.Symbol, sp.Expr]], list[sp.Expr]]:
        """Return common parts and what is left; unordered, as sorting long expressions takes a minute."""
        return sp.cse([*m.derivatives, *m.outputs], order="none", list=False)

    # lambdify walks what it is given once for every way to a common part: half a minute, so it is given nothing
    function = sp.lambdify([*m.states, *m.inputs, *m.parameters], [], "numpy", cse=shared)

    def evaluate(rows: np.ndarray, states: np.ndarray, inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = function(*states, *inputs, *rows)
        values = np.array([np.broadcast_to(v, states.shape[1:]) for v in found], dtype=float)
        return values[: len(m.derivatives)], values[len(m.derivatives) :]

    return evaluate
