r"""Vibration of a flight from its accelerations as they were recorded; a grid no longer has what is faster than itself.

In a window of the time t the specific force is fitted by least squares with what changes slowly and what turns with each
rotor n, whose measured speed is :math:`\omega_n`:

.. math:: a(t) = c_0 + c_1 t + \sum_n (a_n \cos \varphi_n + b_n \sin \varphi_n), \qquad \varphi_n = \int \omega_n dt

An unbalanced rotor shakes the vehicle once a turn. Rotors that turn alike throughout a window share what they shake.

References
----------
.. [1] S. Braun, *Discover Signal Processing*, Wiley, 2008, chapter on rotating machinery: order analysis.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.extend.arrays import FloatArray
from stoop.extend.flights import Channels
from stoop.extend.variables import FAMILIES

FAST: Final = 40.0  #: Hz, of accelerations that show vibration
SECOND: Final = 1.0  #: s, of the windows of what no rotor tells
TURNS: Final = 40.0  #: of the rotors in a window: speeds that are off by 1 % still agree, those 2.5 % apart are told apart
SAMPLES: Final = 2.5  #: for a turn, at least
SINGULAR: Final = 0.01  #: of the strongest direction; weaker ones are of rotors that turn alike
SPEEDS: Final = FAMILIES["rotor"]


@dataclass(frozen=True, eq=False)
class Windows:
    """Mean squares, name -> (n,), m2/s4, in windows around times (n,), s, that are `length` s long."""

    time: FloatArray
    length: float
    squares: Mapping[str, FloatArray]


@dataclass(frozen=True, eq=False)
class Vibration:
    """What the accelerations are above a quarter of their rate, and what turns with each rotor, or why there is none."""

    rough: Windows | None = None
    turning: Windows | None = None
    absent: str = f"no accelerations at {FAST:g} Hz"


NO_VIBRATION: Final = Vibration()


def vibration(channels: Sequence[Channels]) -> Vibration:
    """Return the vibration that channels show, each on its own clock."""
    fast = next(
        (g for g in channels if {*FAMILIES["specific force"]} & g.values.keys() and g.rate >= FAST), None
    )
    if fast is None:
        return NO_VIBRATION
    names = [name for name in FAMILIES["specific force"] if name in fast.values]
    force = np.column_stack([fast.values[name] for name in names])
    rough = _windows(
        fast.time[1:-1],
        fast.rate,
        SECOND,
        names,
        0.5 * np.diff(force, 2, axis=0),
        lambda _, x: np.mean(x**2, 0),
    )
    speeds = {
        name: speed for g in channels for name in SPEEDS if (speed := _speed(g, name, fast.time)) is not None
    }
    if not speeds:
        return Vibration(rough, absent="no speeds of rotors")
    fastest = max(float(np.quantile(speed, 0.9)) for speed in speeds.values()) / (2.0 * np.pi)
    if fast.rate < SAMPLES * fastest:
        slow = f"accelerations at {fast.rate:.0f} Hz do not show what turns {fastest:.0f} times a second"
        return Vibration(rough, absent=slow)
    steps = np.diff(fast.time, prepend=fast.time[0])
    phases = np.cumsum(np.column_stack([*speeds.values()]) * steps[:, None], axis=0)
    turned = np.column_stack([np.cos(phases), np.sin(phases)])
    turning = _windows(
        fast.time, fast.rate, TURNS / fastest, list(speeds), force, lambda at, x: _shaken(turned[at], x)
    )
    return Vibration(rough, turning)


def _speed(group: Channels, name: str, time: FloatArray) -> FloatArray | None:
    """Return the speed (n,) of a rotor at times (n,), rad/s; None where it is not known, or the rotor stands."""
    values = group.values.get(name, np.zeros(0))
    known = np.isfinite(values)
    if not known.any() or np.quantile(values[known], 0.9) <= 0.0:
        return None
    return np.interp(time, group.time[known], values[known])


def _windows(
    time: FloatArray,
    rate: float,
    length: float,
    names: Sequence[str],
    force: FloatArray,
    squares: Callable[[slice, FloatArray], FloatArray],
) -> Windows:
    """Return the mean squares of every window of force (n, m) that has all its samples."""
    count = max(round(min(length * rate, len(time) + 1.0)), 1)
    found, at = list[FloatArray](), list[float]()
    for start in range(0, len(time) - count + 1, count):
        own = slice(start, start + count)
        whole = time[own][-1] - time[own][0] < 1.02 * count / rate
        if whole and np.isfinite(force[own]).all():
            found.append(squares(own, force[own]))
            at.append(float(time[own].mean()))
    columns = np.array(found).reshape(-1, len(names)).T
    return Windows(np.array(at), count / rate, dict(zip(names, columns, strict=True)))


def _shaken(turned: FloatArray, force: FloatArray) -> FloatArray:
    """Return the mean squares (k,) of what turns with k rotors, cosines and sines (n, 2 k), in a force (n, m)."""
    slow = np.vander(np.linspace(-1.0, 1.0, len(force)), 2)
    regressors = np.column_stack([slow, turned])
    normal = regressors.T @ regressors
    found = np.linalg.pinv(normal, rcond=SINGULAR, hermitian=True) @ (regressors.T @ force)
    return np.asarray(0.5 * np.sum(found[2:] ** 2, axis=1).reshape(2, -1).sum(axis=0))
