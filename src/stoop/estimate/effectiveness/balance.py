"""What each rotor is commanded to contribute to lift and to the three moments, in still air.

At rest the equations of `stoop.vehicle.symbolic.rotors` leave thrust T(x) along the axis and torque Q(x) about it; a test
holds the two equal.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.errors import VehicleError
from stoop.vehicle import Vehicle

AXES: Final = ("lift", "roll", "pitch", "yaw")


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
        """Refuse a vehicle that this cannot be asked of."""
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
