"""Flight through turbulence: the noise that drives the gusts, and gusts that have always blown.

The noise of a real atmosphere has no memory; inputs of the kernel are linear between instants. So noise is given on
a grid that is finer than the samples: increments of the gusts over neighboring samples then correlate by 1/(4 FINER)
only, and the variance of a gust of scale length L comes out within a V dt / (3 FINER L) of it.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.simulation.delays import late_inputs, with_slopes
from stoop.vehicle import Vehicle
from stoop.vehicle.vehicle import GUST_STATES, noise_input

FINER: Final = 20  #: steps of the simulation in a sample
# Stationary covariance of the fast and the slow state, over the squared intensity.
_SPREAD: Final = np.linalg.cholesky(np.array([[0.5, 0.25], [0.25, 0.25]]))


def gust_start(vehicle: Vehicle, rng: np.random.Generator) -> dict[str, float]:
    """Return gust states, m/s, as they are met anywhere in turbulence that has no beginning."""
    out: dict[str, float] = {}
    for axis in vehicle.gusts:
        intensity = vehicle.value(f"turbulence.{axis}.intensity")
        drawn = rng.standard_normal(len(GUST_STATES[axis]))
        spread = drawn if len(drawn) == 1 else _SPREAD @ drawn
        out |= dict(zip(GUST_STATES[axis], (intensity * spread).tolist(), strict=True))
    return out


def outputs_in_turbulence(
    vehicle: Vehicle,
    rows: FloatArray,
    start: FloatArray,
    inputs: FloatArray,
    dt: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Return the readings (1, n, n_y) of a flight whose gusts are driven by noise.

    Parameters
    ----------
    rows : (n_p, 1)
        Kernel parameters.
    start : (n_x, 1)
        Kernel states.
    inputs : (n, n_u)
        As recorded; the columns of noise are ignored.
    dt : float, s
        Sample period.
    rng : Generator
    """
    received = late_inputs(vehicle, inputs, rows, dt)
    fine = driven(vehicle, received, gust_noise(vehicle, len(received), dt, rng), dt)
    return np.ascontiguousarray(vehicle.kernel().trajectories(rows, start, fine, dt / FINER)[:, ::FINER])


def driven(vehicle: Vehicle, received: FloatArray, noise: FloatArray, dt: float) -> FloatArray:
    """Return inputs, as they arrive (n, n_u), at `FINER` steps a sample, with the noise that drives the gusts."""
    fine = with_slopes(vehicle, finer(received, FINER), dt / FINER)
    fine[:, gust_columns(vehicle)] = noise
    return fine


def gust_columns(vehicle: Vehicle) -> list[int]:
    """Return the inputs that drive the gusts."""
    return [vehicle.inputs.index(noise_input(axis)) for axis in vehicle.gusts]


def gust_noise(vehicle: Vehicle, count: int, dt: float, rng: np.random.Generator) -> FloatArray:
    """Return noise (FINER (count - 1) + 1, gusts) of unit intensity for a record of samples ``dt``, s, apart."""
    steps = FINER * (count - 1) + 1
    drawn = [rng.standard_normal(steps) for _ in vehicle.gusts]
    return np.asarray(np.column_stack([*drawn, np.empty((steps, 0))]) / np.sqrt(dt / FINER))


def finer(inputs: FloatArray, times: int) -> FloatArray:
    """Return inputs (n, n_u) with ``times`` steps in each sample, linear in between."""
    shares = np.arange(times)[:, None] / times
    between = inputs[:-1, None, :] + shares * np.diff(inputs, axis=0)[:, None, :]
    return np.concatenate([between.reshape(-1, inputs.shape[1]), inputs[-1:]])
