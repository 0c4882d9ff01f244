"""Linear models of one sample at points of a flight, by central differences of the vehicle's own equations.

Axes: b = candidate, r = point, e = number of a move (:attr:`stoop.kernels.SymbolicModel.moves`), i = reading.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.kernels import filtering
from stoop.vehicle import Vehicle
from stoop.vehicle.vehicle import noise_input

_STEP: Final = 1e-4  #: rad, rad/s
_SPEED_STEP: Final = 1e-2  #: m/s
_SPEEDS: Final = ("u", "v", "w")


@dataclass(frozen=True, eq=False)
class Linear:
    """What becomes of a small move over one sample.

    Attributes
    ----------
    transition : (B, r, n_e, n_e)
    readings : (B, r, n_y, n_e)
        What a move does to the readings before it has flown on.
    drive : (B, r, n_e, n_w)
        The move that one unit of noise causes, held over the sample.
    """

    transition: FloatArray
    readings: FloatArray
    drive: FloatArray

    def of(self, models: NDArray[np.int64]) -> Linear:
        """Return the linear models of candidates that share them."""
        return Linear(self.transition[models], self.readings[models], self.drive[models])


def linearized(
    vehicle: Vehicle, rows: FloatArray, states: FloatArray, inputs: FloatArray, dt: float
) -> Linear:
    """Return the linear models of every candidate at every point.

    Parameters
    ----------
    rows : (n_p, B)
        Kernel parameters.
    states : (n_x, r, B)
    inputs : (n_u, r)
    dt : float, s
    """
    kernel = vehicle.kernel()
    steps, noise = move_steps(vehicle), [vehicle.inputs.index(noise_input(a)) for a in vehicle.gusts]
    nx, r, count = states.shape
    ne, nw = len(steps), len(noise)
    moves = np.concatenate([np.zeros((ne, 1)), np.diag(steps), -np.diag(steps), np.zeros((ne, nw))], axis=1)
    many = moves.shape[1]
    shape = (many, r, count)
    x = np.broadcast_to(states[:, None], (nx, *shape)).reshape(nx, -1)
    d = np.broadcast_to(moves[:, :, None, None], (ne, *shape)).reshape(ne, -1)
    u = np.repeat(np.broadcast_to(inputs[:, None, :, None], (len(inputs), many, r, 1)), count, axis=3)
    u[noise, np.arange(1 + 2 * ne, many)] = 1.0
    u = u.reshape(len(inputs), -1)
    p = np.broadcast_to(rows[:, None, None, :], (len(rows), *shape)).reshape(len(rows), -1)
    after, readings = filtering.step(kernel, p, filtering.move(kernel, x, d), u, u, dt)
    after, readings = after.reshape(nx, *shape), readings.reshape(-1, *shape)
    back = moves_of(vehicle, after[:, 0])
    middle = (slice(None), slice(1, 1 + ne)), (slice(None), slice(1 + ne, 1 + 2 * ne))
    turned = (after[middle[0]] - after[middle[1]]) / (2.0 * steps[:, None, None])
    seen = (readings[middle[0]] - readings[middle[1]]) / (2.0 * steps[:, None, None])
    driven = after[:, 1 + 2 * ne :] - after[:, :1]
    return Linear(
        np.einsum("exrb,xfrb->bref", back, turned),
        np.ascontiguousarray(np.transpose(seen, (3, 2, 0, 1))),
        np.einsum("exrb,xwrb->brew", back, driven),
    )


def move_steps(vehicle: Vehicle) -> FloatArray:
    """Return the size (n_e,) of the differences."""
    fast = [name in _SPEEDS or name.startswith("gust.") for name in vehicle.moves]
    return np.where(fast, _SPEED_STEP, _STEP)


def moves_of(vehicle: Vehicle, states: FloatArray) -> FloatArray:
    """Return what makes moves (n_e, n_x, ...) of small differences of states (n_x, ...).

    The columns by which single moves change a state are orthogonal.
    """
    kernel, steps, (nx, *shape) = vehicle.kernel(), move_steps(vehicle), states.shape
    flat = states.reshape(nx, -1)
    out = np.empty((len(steps), *flat.shape))
    for e, step in enumerate(steps):
        move = np.zeros((len(steps), flat.shape[1]))
        move[e] = step
        column = (filtering.move(kernel, flat, move) - filtering.move(kernel, flat, -move)) / (2.0 * step)
        out[e] = column / np.sum(column**2, axis=0)
    return out.reshape(len(steps), nx, *shape)
