"""Performance flight cut into blocks: lift, energy rate and power of each.

Over a block of some seconds, with the airspeed V, the height h and a steady wind,

    (T - D) V = d/dt [m (V^2 / 2 + g h)]        the energy-rate method
    L = m (a_x sin(alpha) - a_z cos(alpha))     from the accelerometers, thrust along the flight path

No accelerometer bias enters drag, and what a gust adds within a block it takes away again. What remains is
vertical wind: a climb of the air of 0.1 m/s is as much as a power of m g 0.1 m/s.

References
----------
Kimberlin, "Flight Testing of Fixed-Wing Aircraft", AIAA, 2003, chapters on energy methods and drag polars.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray, run_slices
from stoop.base.units import STANDARD_GRAVITY
from stoop.errors import FlightError
from stoop.flight import Flight
from stoop.flight.airborne import airborne
from stoop.vehicle.atmosphere import standard_density

BLOCK: Final = 5.0  #: s: longer than motor and pilot take, shorter than a climb
LEAST: Final = 12  #: blocks, below which no parabola is fitted
SWITCHED_OFF: Final = 0.02  #: of full throttle
THROTTLES: Final = ("throttle", "control_throttle")
NEEDED: Final = ("V", "alpha", "ax", "az", "altitude")


@dataclass(frozen=True, eq=False)
class Blocks:
    """Means over blocks; n = block.

    Attributes
    ----------
    time : (n,) s, middle
    stretch : (n,) number of the contiguous stretch that each belongs to
    speed : (n,) m/s, true airspeed
    density : (n,) kg/m3
    lift : (n,) N
    kinetic : (n,) W, rate of m V^2 / 2
    potential : (n,) W, rate of m g h
    alpha : (n,) rad
    power : (n,) W, electric; zero with the motor off
    powered : bool
        Whether the power was measured; else all blocks are glides.
    """

    time: FloatArray
    stretch: NDArray[np.intp]
    speed: FloatArray
    density: FloatArray
    lift: FloatArray
    kinetic: FloatArray
    potential: FloatArray
    alpha: FloatArray
    power: FloatArray
    powered: bool


def blocks(
    flight: Flight, mass: float, windows: Sequence[tuple[float, float]] = (), length: float = BLOCK
) -> Blocks:
    """Cut the airborne part of a flight, or windows of it, into blocks.

    Parameters
    ----------
    flight : Flight
    mass : float, kg
    windows : sequence of (start, stop), s on the log's own clock
    length : float, s

    Raises
    ------
    FlightError
        A channel is missing, nothing tells the power, or too little is left.
    """
    lacking = [
        name for name in NEEDED if name not in flight.data or not np.isfinite(flight.column(name)).any()
    ]
    if lacking:
        raise FlightError(
            f"{flight.name}: a drag polar needs {', '.join(NEEDED)}; this flight lacks {', '.join(lacking)}"
        )
    power, powered = _power(flight)
    good = _usable(flight, power, windows)
    size = round(length * flight.rate)
    starts = [
        (number, at)
        for number, run in enumerate(run_slices(good))
        for at in range(run.start, run.stop - size, size)
    ]
    if len(starts) < LEAST:
        raise FlightError(
            f"{flight.name}: only {len(starts)} blocks of {length:g} s fly with speed, height and "
            f"{'power' if powered else 'the motor off'} known, at least {LEAST} are needed; give longer windows"
        )
    return _cut(flight, mass, power, powered, starts, size)


def _power(flight: Flight) -> tuple[FloatArray, bool]:
    """Return the electric power (n,), zero where the throttle is closed and NaN where nothing is known."""
    if {"voltage", "current"} <= {str(name) for name in flight.data.data_vars}:
        return flight.column("voltage") * flight.column("current"), True
    for name in THROTTLES:
        if name in flight.data and np.nanmax(flight.column(name), initial=0.0) > SWITCHED_OFF:
            return np.where(flight.column(name) <= SWITCHED_OFF, 0.0, np.nan), False
    raise FlightError(
        f"{flight.name}: nothing tells the power: neither voltage and current of the battery, nor a throttle that "
        "shows where the motor is off; log one of them"
    )


def _usable(flight: Flight, power: FloatArray, windows: Sequence[tuple[float, float]]) -> NDArray[np.bool_]:
    good = airborne(flight) & np.isfinite(power)
    for name in NEEDED:
        good &= np.isfinite(flight.column(name))
    if windows:
        inside = [(flight.time >= a) & (flight.time <= b) for a, b in windows]
        good &= np.logical_or.reduce(inside)
    return np.asarray(good)


def _cut(
    flight: Flight,
    mass: float,
    power: FloatArray,
    powered: bool,
    starts: Sequence[tuple[int, int]],
    size: int,
) -> Blocks:
    first = np.array([at for _, at in starts])
    column = {name: flight.column(name) for name in NEEDED}
    lift = mass * (column["ax"] * np.sin(column["alpha"]) - column["az"] * np.cos(column["alpha"]))
    lapse = size / flight.rate

    def mean(x: FloatArray) -> FloatArray:
        return np.array([np.nanmean(x[at : at + size]) for at in first])

    def rate(x: FloatArray) -> FloatArray:
        return np.asarray((x[first + size] - x[first]) / lapse)

    return Blocks(
        mean(flight.time), np.array([number for number, _ in starts]), mean(column["V"]), mean(_density(flight)),
        mean(lift), rate(0.5 * mass * column["V"] ** 2), rate(mass * STANDARD_GRAVITY * column["altitude"]),
        mean(column["alpha"]), mean(power), powered,
    )  # fmt: skip


def _density(flight: Flight) -> FloatArray:
    if "density" in flight.data and np.isfinite(flight.column("density")).any():
        known = flight.column("density")
        return np.where(np.isfinite(known), known, np.nanmedian(known))
    return np.asarray(standard_density(flight.column("altitude")))
