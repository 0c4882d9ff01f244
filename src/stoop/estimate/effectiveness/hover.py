"""One flight near hover in a few numbers: what the rotors were commanded to give, on average, and how well that is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray, run_slices
from stoop.errors import FlightError
from stoop.estimate.effectiveness.balance import Balance
from stoop.flight import Flight

AIRBORNE: Final = 0.6  #: of the median thrust while any is commanded
SETTLE: Final = 2.0  #: s after take-off and before landing that are left out
LEAST: Final = 4.0  #: s that must be left
BLOCK: Final = 1.0  #: s; commands correlate for a few tenths of a second
FAST: Final = 3.0  #: m/s; above, drag and inflow are no longer small


@dataclass(frozen=True)
class Hover:
    """What the rotors were commanded to give while the vehicle hovered.

    Attributes
    ----------
    name : str
        Of the flight.
    thrust, torque : (n,)
        Mean of each rotor, N and N m.
    covariance : (4, 4)
        Of lift, N, and the moments, N m, of all rotors together: scatter of blocks within the flight.
    voltage : float
        Mean, V; NaN where it was not recorded.
    duration : float
        s
    """

    name: str
    thrust: FloatArray
    torque: FloatArray
    covariance: FloatArray
    voltage: float
    duration: float


def hover(flight: Flight, balance: Balance) -> Hover:
    """Return what a flight says of the rotors.

    Between the settled start and end of a stretch in the air the velocity changes by next to nothing, so the mean
    forces and moments are those of rest, however the vehicle moved to and fro in between.

    Raises
    ------
    FlightError
        A command is missing, the flight is too short or too fast.
    """
    commands = _commands(flight, balance)
    thrust, torque = balance.drive(commands)
    inside = _settled(flight, thrust.sum(axis=0))
    _check_slow(flight, inside)
    thrust, torque = thrust[:, inside], torque[:, inside]
    sums = balance.of_thrust @ thrust + balance.of_torque @ torque
    voltage = commands.get("voltage")
    return Hover(
        flight.name,
        thrust.mean(axis=1),
        torque.mean(axis=1),
        _scatter(sums, flight.rate),
        float("nan") if voltage is None else float(np.mean(voltage[inside])),
        sums.shape[1] / flight.rate,
    )


def together(hovers: Sequence[Hover]) -> Hover:
    """Return the mean of flights of one configuration, as of one flight."""
    count = len(hovers)
    return Hover(
        f"{count} flights",
        np.mean([h.thrust for h in hovers], axis=0),
        np.mean([h.torque for h in hovers], axis=0),
        np.sum([h.covariance for h in hovers], axis=0) / count**2,
        float(np.mean([h.voltage for h in hovers])),
        sum(h.duration for h in hovers),
    )


def _commands(flight: Flight, balance: Balance) -> dict[str, FloatArray]:
    there = {str(name) for name in flight.data.data_vars}
    needed = [*balance.channels, *(["voltage"] if balance.needs_voltage else [])]
    missing = [name for name in needed if name not in there]
    if missing:
        raise FlightError(
            f"{flight.name}: {', '.join(missing)} not recorded; log the commands of all rotors, or name them in a mapping"
        )
    commands = {name: flight.column(name) for name in {*needed, *({"voltage"} & there)}}
    empty = [name for name in needed if not np.isfinite(commands[name]).any()]
    if empty:
        raise FlightError(
            f"{flight.name}: {', '.join(empty)} holds no number throughout; look at the column that the mapping names for it"
        )
    return commands


def _settled(flight: Flight, thrust: FloatArray) -> NDArray[np.bool_]:
    """Return where it is in the air, (k,), without the ends of each stretch; thrust is that of all rotors, (k,)."""
    known = np.isfinite(thrust)
    turning = thrust[known & (thrust > 0.0)]
    if not turning.size:
        raise FlightError(
            f"{flight.name}: the motors are off throughout; choose a log of a flight, and check the commands' unit"
        )
    cut = round(SETTLE * flight.rate)
    kept = np.zeros(thrust.size, dtype=bool)
    for stretch in run_slices(known & (thrust > AIRBORNE * np.median(turning))):
        kept[stretch.start + cut : max(stretch.stop - cut, 0)] = True
    seconds = float(kept.sum()) / flight.rate
    if seconds < LEAST:
        raise FlightError(
            f"{flight.name}: {seconds:.1f} s near hover, take-offs and landings aside; {LEAST:g} s are needed at least"
        )
    return kept


def _check_slow(flight: Flight, inside: NDArray[np.bool_]) -> None:
    if {"vn", "ve"} <= {str(name) for name in flight.data.data_vars}:
        speed = np.hypot(flight.column("vn")[inside], flight.column("ve")[inside])
        if np.isfinite(speed).any() and np.nanmedian(speed) > FAST:
            raise FlightError(
                f"{flight.name}: half of it is faster than {np.nanmedian(speed):.1f} m/s; choose a flight near hover, "
                f"below {FAST:g} m/s"
            )


def _scatter(sums: FloatArray, rate: float) -> FloatArray:
    """Return the covariance (4, 4) of the mean of (4, k) correlated samples, from the scatter of means of blocks."""
    size = max(round(BLOCK * rate), 1)
    count = sums.shape[1] // size
    blocks = sums[:, : count * size].reshape(4, count, size).mean(axis=2)
    return np.asarray(np.cov(blocks) / count)
