"""States along a flight: one step at a time, or all of a known record; through gusts where the vehicle has some."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.kernels.filtering import innovations, step
from stoop.simulation.delays import late_inputs
from stoop.simulation.turbulence import FINER, driven, gust_noise
from stoop.vehicle import Vehicle

_AT_ONCE = 10_000  #: samples: each has all parameters beside it


@dataclass(frozen=True, eq=False)
class Stepper:
    """Takes states from sample to sample, as the kernel's own time loop does.

    Attributes
    ----------
    rows : (n_p, 1)
    dt : float, s
    noise : (FINER (n - 1) + 1, gusts)
        What drives each of them.
    """

    vehicle: Vehicle
    rows: FloatArray
    dt: float
    noise: FloatArray

    @classmethod
    def of(
        cls, vehicle: Vehicle, rows: FloatArray, count: int, dt: float, rng: np.random.Generator
    ) -> Stepper:
        """Draw the noise of a whole flight."""
        return cls(vehicle, rows, dt, gust_noise(vehicle, count, dt, rng))

    def step(self, k: int, state: FloatArray, now: FloatArray, following: FloatArray) -> FloatArray:
        """Return the state (n_x,) at sample k + 1; inputs (n_u,) go in straight lines."""
        kernel = self.vehicle.kernel()
        if not self.vehicle.gusts:
            after, _ = step(kernel, self.rows, state[:, None], now[:, None], following[:, None], self.dt)
            return np.asarray(after[:, 0])
        noise = self.noise[FINER * k : FINER * (k + 1) + 1]
        fine = driven(self.vehicle, np.stack([now, following]), noise, self.dt)
        return np.asarray(states_along(self.vehicle, self.rows, state[:, None], fine, self.dt / FINER)[-1])


def states_along(
    vehicle: Vehicle, rows: FloatArray, start: FloatArray, inputs: FloatArray, dt: float
) -> FloatArray:
    """Return states (n, n_x) of a record whose inputs (n, n_u), as they arrive, are known."""
    kernel = vehicle.kernel()
    still = np.zeros((1, kernel.moves * len(vehicle.outputs), 1))
    unseen = np.full((len(inputs), len(vehicle.outputs)), np.nan)
    which = np.zeros(len(inputs), dtype=np.int64)
    _, path = innovations(kernel, rows, start, still, which, inputs, unseen, dt, states=True)
    return np.asarray(path[0])


def states_flown(
    vehicle: Vehicle,
    rows: FloatArray,
    start: FloatArray,
    inputs: FloatArray,
    dt: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Return states (n, n_x) of a flight whose recorded inputs (n, n_u) are known; gusts as `rng` drives them."""
    received = late_inputs(vehicle, inputs, rows, dt)
    if not vehicle.gusts:
        return states_along(vehicle, rows, start, received, dt)
    fine = driven(vehicle, received, gust_noise(vehicle, len(received), dt, rng), dt)
    return np.asarray(states_along(vehicle, rows, start, fine, dt / FINER)[::FINER])


def readings_along(
    vehicle: Vehicle, rows: FloatArray, states: FloatArray, received: FloatArray
) -> FloatArray:
    """Return what instruments read (n, n_y) of states (n, n_x) and inputs (n, n_u) as they arrive."""
    kernel, every = vehicle.kernel(), np.repeat(rows, min(len(states), _AT_ONCE), axis=1)
    out = np.empty((len(states), len(vehicle.outputs)))
    for a in range(0, len(states), _AT_ONCE):
        x, u = states[a : a + _AT_ONCE].T.copy(), received[a : a + _AT_ONCE].T.copy()
        out[a : a + _AT_ONCE] = kernel.evaluate(every[:, : x.shape[1]].copy(), x, u)[1].T
    return out


def traveled(velocity: FloatArray, dt: float) -> FloatArray:
    """Return positions (n, 3), m, of velocities (n, 3), from zero."""
    steps = 0.5 * dt * (velocity[1:] + velocity[:-1])
    return np.vstack([np.zeros((1, velocity.shape[1])), np.cumsum(steps, axis=0)])
