"""How a full command about an axis moves motors: shares by their places, and the linearization of their thrust."""

from __future__ import annotations

import math

import numpy as np

from stoop.extend.arrays import FloatArray
from stoop.extend.errors import StoopError


def by_place(positions: FloatArray, turning: FloatArray, most: tuple[float, float, float]) -> FloatArray:
    """Return how much each motor (n, 3) is commanded by a full command about each axis, in proportion to its moment.

    Parameters
    ----------
    positions : (n, 3) of rotors that push up, m from the center of gravity
    turning : (n,) one for counterclockwise as seen from above, minus one for clockwise
    most : of the shares about each axis
    """
    moments = np.column_stack([-positions[:, 1], positions[:, 0], turning])
    largest = np.abs(moments).max(axis=0)
    if not np.all(largest > 0.0):
        raise StoopError(
            "mixing: the rotors have no moment about an axis: write their positions into the vehicle file"
        )
    return np.asarray(moments / largest * np.array(most))


def thrust_slope(curve: float, thrust: float) -> float:
    """Return the change of a motor's command over that of the thrust that is asked for, both from 0 to 1.

    The firmware inverts thrust = curve command^2 + (1 - curve) command.
    """
    return 1.0 / math.sqrt((1.0 - curve) ** 2 + 4.0 * curve * thrust)


def thrust_of(curve: float, command: FloatArray) -> FloatArray:
    """Return thrust over the greatest for commands from 0 to 1, by the curve that firmwares invert."""
    return np.asarray(curve * command**2 + (1.0 - curve) * command)


def command_of(curve: float, thrust: FloatArray) -> FloatArray:
    """Return the command from 0 to 1 for thrust over the greatest; the inverse of :func:`thrust_of`."""
    linear = 1.0 - curve
    return np.asarray(2.0 * thrust / (linear + np.sqrt(np.maximum(linear**2 + 4.0 * curve * thrust, 1e-12))))
