"""A linear model as the objects of python-control and SciPy, its delays as Padé approximations in series."""

from __future__ import annotations

from math import factorial
from typing import TYPE_CHECKING, Any

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.extras import install
from stoop.errors import SimulationError, StoopError

if TYPE_CHECKING:
    from stoop.simulation.linearize import LinearModel

System = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


def pade(delay: float, order: int) -> System:
    """Return A, B, C, D of the Padé approximation of a delay, s: an all-pass of equal degrees above and below.

    exp(-sT) = P(-sT) / P(sT) with P(z) = sum of (2n - k)! n! / ((2n)! k! (n - k)!) z^k (Golub and Van Loan, *Matrix
    Computations*, 4th ed., section 9.3.1).
    """
    from scipy.signal import tf2ss

    n = order
    divisors = [factorial(2 * n) * factorial(k) * factorial(n - k) for k in range(n + 1)]
    weights = [factorial(2 * n - k) * factorial(n) / divisors[k] for k in range(n + 1)]
    below = np.array([w * delay**k for k, w in enumerate(weights)])
    above = below * (-1.0) ** np.arange(n + 1)
    A, B, C, D = tf2ss(above[::-1], below[::-1])
    return A, B, C, D


def series(first: System, then: System) -> System:
    """Return the system in which the outputs of the first are the inputs of the other; its states come after."""
    A1, B1, C1, D1 = first
    A2, B2, C2, D2 = then
    A = np.block([[A1, np.zeros((len(A1), len(A2)))], [B2 @ C1, A2]])
    return A, np.vstack([B1, B2 @ D1]), np.hstack([D2 @ C1, C2]), D2 @ D1


def side_by_side(delays: FloatArray, order: int) -> System:
    """Return the system of signals that do not act on each other, each late by its delay, s."""
    from scipy.linalg import block_diag

    through = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1))
    parts = [pade(delay, order) if delay > 0.0 else through for delay in delays.tolist()]
    A, B, C, D = (np.asarray(block_diag(*matrices)) for matrices in zip(*parts, strict=True))
    return A, B, C, D


def with_delays(model: LinearModel, order: int | None) -> tuple[System, tuple[str, ...]]:
    """Return A, B, C, D of a model with its delays, and the names of the states.

    Raises
    ------
    SimulationError
        There are delays and no order is given, or one is negative.
    """
    system = model.A, model.B, model.C, model.D
    delays = [*model.input_delays.tolist(), *model.output_delays.tolist()]
    if not any(delays) or order == 0:
        return system, model.states
    if order is None or min(delays) < 0.0:
        raise SimulationError(
            f"the model has delays of up to {max(delays, key=abs):g} s: give pade=N, the order of their approximation, or "
            "pade=0 to leave them out"
        )
    system = series(side_by_side(model.input_delays, order), system)
    before = len(system[0]) - len(model.states)
    system = series(system, side_by_side(model.output_delays, order))
    after = len(system[0]) - before - len(model.states)
    names = [f"input_delay_{i}" for i in range(before)], [f"output_delay_{i}" for i in range(after)]
    return system, (*names[0], *model.states, *names[1])


def control_system(model: LinearModel, order: int | None = None) -> Any:
    """Return a ``control.StateSpace`` with the names of states, inputs and outputs.

    Raises
    ------
    StoopError
        python-control is not installed, or as of :func:`with_delays`.
    """
    try:
        import control
    except ModuleNotFoundError:
        raise StoopError(f"python-control: the package is not installed; {install('control')}") from None
    matrices, states = with_delays(model, order)
    # Names of python-control may not hold dots, of which it makes those of subsystems.
    signals = {"states": states, "inputs": model.inputs, "outputs": model.outputs}
    labels = {key: [name.replace(".", "_") for name in names] for key, names in signals.items()}
    return control.StateSpace(*matrices, remove_useless_states=False, **labels)
