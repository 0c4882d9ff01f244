"""A pendulum with two states, small enough to compile in a moment: as equations and as plain Python."""

import math

import numpy as np
import sympy as sp

from stoop.kernels import SymbolicModel

STATES, INPUTS, PARAMETERS, OUTPUTS = 2, 1, 3, 3


def equations() -> SymbolicModel:
    """Write a damped pendulum of gain k, damping d and torque b u; its angle is observed wrapped."""
    x, y, u, k, d, b = sp.symbols("angle rate torque k d b", real=True)
    return SymbolicModel(
        states=(x, y),
        inputs=(u,),
        parameters=(k, d, b),
        derivatives=(y, b * u - d * y - k * x + 0.1 * k * x**3),
        outputs=(sp.atan2(x, 1 + x**2), y, sp.sqrt(1 + d**2) * y + sp.Abs(u)),
        output_names=("phi", "q", "az"),
        wrapped=(True, False, False),
    )


def rates(x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
    k, d, b = p
    return np.array([x[1], b * u[0] - d * x[1] - k * x[0] + 0.1 * k * x[0] ** 3])


def readings(x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
    d = p[1]
    return np.array([math.atan2(x[0], 1 + x[0] ** 2), x[1], math.sqrt(1 + d * d) * x[1] + abs(u[0])])
