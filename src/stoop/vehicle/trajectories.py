"""Trajectories of states and readings, in calm air and through turbulence.

Gusts are driven by white noise, and inputs of the kernel are linear between instants. The noise is therefore given on a
grid `FINER` times finer than the samples: increments of the gusts over neighboring samples then correlate by
1/(4 FINER) only, and the variance of a gust of scale length L is right within a share V dt / (3 FINER L).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.kernels.filtering import innovations
from stoop.vehicle.channels import GUST_STATES, noise_input
from stoop.vehicle.delays import with_slopes

if TYPE_CHECKING:
    from stoop.vehicle.vehicle import Vehicle

FINER: Final = 20  #: steps of the simulation in a sample
BLOCK: Final = 10_000  #: samples evaluated together: each has a copy of all parameters


def gust_start(vehicle: Vehicle, rng: np.random.Generator) -> dict[str, float]:
    """Draw gust states, m/s, from their stationary distribution."""
    # Stationary covariance of the fast and the slow state, over the squared intensity.
    root = np.linalg.cholesky(np.array([[0.5, 0.25], [0.25, 0.25]]))
    out: dict[str, float] = {}
    for axis in vehicle.gusts:
        drawn = rng.standard_normal(len(GUST_STATES[axis]))
        spread = drawn if len(drawn) == 1 else root @ drawn
        intensity = vehicle.value(f"turbulence.{axis}.intensity")
        out |= dict(zip(GUST_STATES[axis], (intensity * spread).tolist(), strict=True))
    return out


def gust_noise(vehicle: Vehicle, count: int, dt: float, rng: np.random.Generator) -> FloatArray:
    """Return noise (FINER (count - 1) + 1, gusts) of unit intensity for a record of samples `dt`, s, apart."""
    steps = FINER * (count - 1) + 1
    drawn = [rng.standard_normal(steps) for _ in vehicle.gusts]
    return np.asarray(np.column_stack([*drawn, np.empty((steps, 0))]) / np.sqrt(dt / FINER))


def finer(inputs: FloatArray, times: int) -> FloatArray:
    """Return inputs (n, n_u) with `times` steps in each sample, linear in between."""
    shares = np.arange(times)[:, None] / times
    steps = inputs[:-1, None, :] + shares * np.diff(inputs, axis=0)[:, None, :]
    return np.concatenate([steps.reshape(-1, inputs.shape[1]), inputs[-1:]])


def driven(vehicle: Vehicle, received: FloatArray, noise: FloatArray, dt: float) -> FloatArray:
    """Return inputs, as they arrive (n, n_u), at `FINER` steps a sample, with the noise that drives the gusts."""
    fine = with_slopes(vehicle, finer(received, FINER), dt / FINER)
    fine[:, [vehicle.inputs.index(noise_input(axis)) for axis in vehicle.gusts]] = noise
    return fine


def states_along(
    vehicle: Vehicle, rows: FloatArray, start: FloatArray, inputs: FloatArray, dt: float
) -> FloatArray:
    """Return states (n, n_x) of a record whose inputs (n, n_u), as they arrive, are known."""
    kernel = vehicle.kernel()
    gains = np.zeros((1, kernel.moves * len(vehicle.outputs), 1))
    measured = np.full((len(inputs), len(vehicle.outputs)), np.nan)
    which = np.zeros(len(inputs), dtype=np.int64)
    _, path = innovations(kernel, rows, start, gains, which, inputs, measured, dt, states=True)
    return np.asarray(path[0])


def arriving(
    vehicle: Vehicle, rows: FloatArray, inputs: FloatArray, dt: float, noise: FloatArray
) -> tuple[FloatArray, int]:
    """Return recorded inputs (n, n_u) as they arrive, with the noise of gusts if there are any, and their steps in a sample.

    Parameters
    ----------
    rows : (n_p, 1)
        Kernel parameters.
    dt : float, s
    noise : (FINER (n - 1) + 1, gusts)
        As of :func:`gust_noise`.
    """
    received = vehicle.late_inputs(inputs, rows, dt)
    return (driven(vehicle, received, noise, dt), FINER) if vehicle.gusts else (received, 1)


def readings_along(
    vehicle: Vehicle, rows: FloatArray, states: FloatArray, received: FloatArray
) -> FloatArray:
    """Return the readings (n, n_y) at states (n, n_x) and inputs (n, n_u) as they arrive."""
    kernel, every = vehicle.kernel(), np.repeat(rows, min(len(states), BLOCK), axis=1)
    out = np.empty((len(states), len(vehicle.outputs)))
    for a in range(0, len(states), BLOCK):
        x, u = states[a : a + BLOCK].T.copy(), received[a : a + BLOCK].T.copy()
        out[a : a + BLOCK] = kernel.evaluate(every[:, : x.shape[1]].copy(), x, u)[1].T
    return out


def next_states(
    vehicle: Vehicle,
    rows: FloatArray,
    states: FloatArray,
    inputs: FloatArray,
    noise: Sequence[FloatArray],
    dt: float,
) -> FloatArray:
    """Return the states (n_x, B) one sample later, as the kernel's own time loop does.

    Parameters
    ----------
    rows : (n_p, B)
    states : (n_x, B)
    inputs : (2, n_u, B)
        As they arrive, at this sample and at the next.
    noise : B arrays (FINER + 1, gusts), or (gusts,)
        Driving the gusts from this sample to the next.
    dt : float, s
    """
    if not vehicle.gusts:
        return vehicle.kernel().step(rows, states, inputs[0], inputs[1], dt)[0]
    fine = (driven(vehicle, inputs[:, :, i], one, dt) for i, one in enumerate(noise))
    ends = [
        vehicle.states_along(rows[:, i : i + 1], states[:, i : i + 1], one, dt / FINER)[-1]
        for i, one in enumerate(fine)
    ]
    return np.column_stack(ends)
