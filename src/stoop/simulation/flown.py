"""A simulated flight before it is recorded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray
from stoop.simulation.trim import Trim


@dataclass(frozen=True)
class Flown:
    """A simulated flight without sensor noise."""

    trim: Trim
    time: FloatArray  #: (n,), s
    inputs: FloatArray  #: (n, n_u), recorded channels
    outputs: FloatArray  #: (n, n_y), noise-free readings in the order of ``vehicle.outputs``
    #: (n, 3), over ground, m/s; of aircraft only in the wind of a maneuver
    velocity: FloatArray | None = None
    clipped: BoolArray | None = None  #: (n, m), on rotors: where a channel reached an end of its range
    states: FloatArray | None = None  #: (n, n_x), on rotors


def traveled(velocity: FloatArray, dt: float) -> FloatArray:
    """Return positions (n, 3), m, from velocities (n, 3) by the trapezoidal rule, starting at zero."""
    steps = 0.5 * dt * (velocity[1:] + velocity[:-1])
    return np.vstack([np.zeros((1, velocity.shape[1])), np.cumsum(steps, axis=0)])
