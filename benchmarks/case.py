"""The engine's case: the built-in twin-boom aircraft, all six degrees of freedom, 30 s at 100 Hz."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.kernels import Kernel
from stoop.simulation.fly import fly
from stoop.simulation.maneuver import Maneuver
from stoop.simulation.trim import Flown
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import load_vehicle

RATE = 100.0
SPREAD = 0.1  #: of the candidates' coefficients about the truth
MANEUVER = Maneuver.model_validate(
    {
        "duration": 29.99,
        "rate": RATE,
        "input": [
            {"control": "elevator", "shape": "3-2-1-1", "start": 1.0, "step": 0.3, "amplitude": 0.1},
            {"control": "elevator", "shape": "pulse", "start": 8.0, "duration": 3.0, "amplitude": 0.04},
            {"control": "aileron", "shape": "doublet", "start": 14.0, "step": 1.0, "amplitude": 0.052},
            {"control": "rudder", "shape": "doublet", "start": 20.0, "step": 1.0, "amplitude": 0.07},
        ],
    }
)  #: 3000 samples


@dataclass(frozen=True)
class Case:
    """A flown maneuver and the vehicle that flew it."""

    vehicle: Vehicle
    flown: Flown

    @property
    def kernel(self) -> Kernel:
        """The compiled equations."""
        return self.vehicle.kernel()

    @property
    def coefficients(self) -> list[int]:
        """Kernel rows of the 32 coefficients of eq. (1)."""
        return [
            self.vehicle.rows[p.name]
            for p in self.vehicle.parameters
            if p.free and not p.name.startswith("sensors.")
        ]

    def rows(self, count: int) -> FloatArray:
        """Return kernel parameters (n_p, count) of candidates about the truth; the first is the truth."""
        rows = self.vehicle.parameter_rows(self.flown.trim.changes, count)
        spread = np.random.default_rng(7).uniform(-SPREAD, SPREAD, (len(self.coefficients), count))
        spread[:, 0] = 0.0
        rows[self.coefficients] *= 1.0 + spread
        return rows

    def start(self, rows: FloatArray) -> FloatArray:
        """Return initial states (n_x, count)."""
        return self.vehicle.initial_states(self.flown.trim.start, rows, self.flown.inputs[0])

    def cost(self, count: int, threads: int = 1, kernel: Kernel | None = None) -> Callable[[], FloatArray]:
        """Return a call that costs ``count`` candidates; `kernel` may be one that is made for another processor."""
        rows, kernel, flown = self.rows(count), kernel or self.kernel, self.flown
        start, weights = self.start(rows), np.ones_like(flown.outputs)
        return lambda: kernel.cost(
            rows, start, flown.inputs, flown.outputs, weights, 1.0 / RATE, threads=threads
        )

    def outputs(self, count: int, delays: bool = False) -> Callable[[], FloatArray]:
        """Return a call that gives the outputs of ``count`` candidates.

        With ``delays`` each has inputs of its own, as when a delay is free.
        """
        rows, kernel, inputs = self.rows(count), self.kernel, self.flown.inputs
        start = self.start(rows)
        if delays:
            inputs = np.repeat(inputs[:, :, None], count, axis=2)
        return lambda: kernel.trajectories(rows, start, inputs, 1.0 / RATE, threads=1)


def full() -> Case:
    """Return the case."""
    vehicle = load_vehicle("twin-boom")
    return Case(vehicle, fly(vehicle, MANEUVER))
