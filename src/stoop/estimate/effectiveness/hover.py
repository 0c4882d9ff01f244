"""A flight near hover as mean thrust and torque of each rotor, and their loads on the vehicle.

At rest the equations of `stoop.vehicle.symbolic.forces` leave thrust T(x) along the axis and torque Q(x) about it; a test
compares the two.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray, run_slices
from stoop.errors import FlightError, VehicleError
from stoop.flight import Flight
from stoop.vehicle import Vehicle

AIRBORNE: Final = 0.6  #: of the median thrust while any is commanded
SETTLE: Final = 2.0  #: s after take-off and before landing that are left out
MIN_DURATION: Final = 4.0  #: s near hover
BLOCK: Final = 1.0  #: s; commands correlate for a few tenths of a second
MAX_SPEED: Final = 3.0  #: m/s; above, drag and inflow are not small


@dataclass(frozen=True)
class Balance:
    """The rotors of a vehicle as they act on it at hover.

    Attributes
    ----------
    vehicle : Vehicle
        With rotors.
    """

    vehicle: Vehicle

    def __post_init__(self) -> None:
        """Refuse a vehicle without rotors or without their torque."""
        if not self.vehicle.rotors:
            raise VehicleError(
                f"{self.vehicle.where}: has no rotors; add [rotors] and a table for each rotor"
            )
        if "rotors.torque_ratio" not in self.vehicle.rows and "rotors.Q2" not in self.vehicle.rows:
            raise VehicleError(
                f"{self.vehicle.where}: rotors.torque_ratio is missing: without a torque the balance of yaw is unknown; "
                "write torque_ratio = 0.01 (m), or what was measured"
            )

    @property
    def rotors(self) -> tuple[str, ...]:
        """Names, in the order of the columns below."""
        return self.vehicle.rotors

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """Recorded channel of each rotor."""
        return tuple(self.vehicle.file.rotor[name].channel for name in self.rotors)

    @property
    def needs_voltage(self) -> bool:
        """Whether commands are corrected with the measured voltage."""
        return "rotors.nominal_voltage" in self.vehicle.rows

    @cached_property
    def directions(self) -> FloatArray:
        """Shape (3, n): unit vector of each rotor's thrust, body axes."""
        axes = [self._point(f"rotor.{name}.axis", (0.0, 0.0, -1.0)) for name in self.rotors]
        return np.array([a / np.linalg.norm(a) for a in axes]).T

    @cached_property
    def of_thrust(self) -> FloatArray:
        """Shape (4, n): lift and moments (roll, pitch, yaw; m) of a thrust of 1 N of each rotor."""
        center = self._point("mass.center_of_gravity", (0.0, 0.0, 0.0))
        arms = np.array([self._point(f"rotor.{name}.position") - center for name in self.rotors])
        moments = np.cross(arms, self.directions.T).T
        return np.vstack([-self.directions[2], moments])

    @cached_property
    def of_torque(self) -> FloatArray:
        """Shape (4, n): what a torque of 1 N m of each rotor does."""
        turns = np.array([1.0 if self.vehicle.file.rotor[n].spin == "ccw" else -1.0 for n in self.rotors])
        return np.vstack([np.zeros(len(self.rotors)), -turns * self.directions])

    @cached_property
    def arm(self) -> float:
        """Mean horizontal distance of the rotors from the center of gravity, m."""
        return float(np.mean(np.hypot(self.of_thrust[1], self.of_thrust[2])))

    def drive(self, commands: Mapping[str, FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return what each rotor is commanded to give.

        Parameters
        ----------
        commands : channel -> (k,) as recorded; with ``voltage``, V, where the vehicle needs it

        Returns
        -------
        thrust : (n, k), N, along the rotor's axis
        torque : (n, k), N m, about it
        """
        x = np.array([self._command(commands[channel], commands) for channel in self.channels])
        thrust, factor = self._polynomial("T", x), self._each("factor")[:, None]
        by_ratio = "rotors.torque_ratio" in self.vehicle.rows
        torque = self._number("rotors.torque_ratio") * thrust if by_ratio else self._polynomial("Q", x)
        return factor * thrust, factor * self._each("torque_factor")[:, None] * torque

    def loads(self, thrust: FloatArray, torque: FloatArray) -> FloatArray:
        """Return (4, n) what thrust (n,) and torque (n,) of each rotor do: lift, N, and moments, N m."""
        return np.asarray(self.of_thrust * thrust + self.of_torque * torque)

    def _command(self, channel: FloatArray, commands: Mapping[str, FloatArray]) -> FloatArray:
        x = self._number("rotors.gain", 1.0) * np.maximum(channel - self._number("rotors.idle"), 0.0)
        if self.needs_voltage:
            x = x * commands["voltage"] / self._number("rotors.nominal_voltage")
        return np.asarray(x)

    def _polynomial(self, letter: str, x: FloatArray) -> FloatArray:
        zeroth, first, second = (self._number(f"rotors.{letter}{i}") for i in range(3))
        return np.asarray(zeroth + x * (first + x * second))

    def _each(self, last: str) -> FloatArray:
        return np.array([self._number(f"rotor.{name}.{last}", 1.0) for name in self.rotors])

    def _number(self, name: str, default: float = 0.0) -> float:
        return self.vehicle.value(name) if name in self.vehicle.rows else default

    def _point(self, name: str, default: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> FloatArray:
        return np.array([self._number(f"{name}.{a}", d) for a, d in zip("xyz", default, strict=True)])


@dataclass(frozen=True)
class Hover:
    """Commanded thrust and torque of each rotor while the vehicle hovered.

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
    """Return the mean commands of a flight near hover.

    Between start and end of a stretch near hover the velocity hardly changes, so mean forces and moments are those of rest,
    whatever the motion in between.

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


def pooled(hovers: Sequence[Hover]) -> Hover:
    """Return the mean of flights of one configuration as one flight."""
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


def _settled(flight: Flight, thrust: FloatArray) -> BoolArray:
    """Return where the vehicle is airborne, (k,), without the ends of each stretch; `thrust` (k,) is that of all rotors."""
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
    if seconds < MIN_DURATION:
        raise FlightError(
            f"{flight.name}: {seconds:.1f} s near hover, take-offs and landings aside; {MIN_DURATION:g} s are needed at least"
        )
    return kept


def _check_slow(flight: Flight, inside: BoolArray) -> None:
    if {"vn", "ve"} <= {str(name) for name in flight.data.data_vars}:
        speed = np.hypot(flight.column("vn")[inside], flight.column("ve")[inside])
        if np.isfinite(speed).any() and np.nanmedian(speed) > MAX_SPEED:
            raise FlightError(
                f"{flight.name}: half of it is faster than {np.nanmedian(speed):.1f} m/s; choose a flight near hover, "
                f"below {MAX_SPEED:g} m/s"
            )


def _scatter(sums: FloatArray, rate: float) -> FloatArray:
    """Return the covariance (4, 4) of the mean of (4, k) correlated samples, from the scatter of means of blocks."""
    size = max(round(BLOCK * rate), 1)
    count = sums.shape[1] // size
    blocks = sums[:, : count * size].reshape(4, count, size).mean(axis=2)
    return np.asarray(np.cov(blocks) / count)
