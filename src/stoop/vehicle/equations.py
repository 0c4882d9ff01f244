"""The equations of a vehicle in SymPy, for printing: of symbols that the caller chooses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stoop.kernels.emit import scalar_text
from stoop.vehicle.atmosphere import polynomial_density
from stoop.vehicle.defaults import SHORTEST_LAG
from stoop.vehicle.symbolic import airflow, forces, frames, readings
from stoop.vehicle.symbolic.frames import NULL, Air, Numbers, Quaternion, Vector
from stoop.vehicle.vehicle import Vehicle


class SymbolicEquations:
    """Equations of a vehicle whose numbers are symbols, those of :attr:`numbers`; SI and rad."""

    SHORTEST_LAG = SHORTEST_LAG  #: s, of :func:`stoop.vehicle.symbolic.forces.lagged`
    text = staticmethod(scalar_text)
    over_ground = staticmethod(frames.over_ground)

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle, self.numbers = vehicle, Numbers(vehicle)

    def density(self, height: Any, channels: Mapping[str, Any]) -> Any:
        """Return the density of the air at a height: that of its channel, of the standard atmosphere, or the number."""
        choice = self.vehicle.file.environment.density
        if choice == "log":
            return channels["density"]
        return polynomial_density(height) if choice == "standard" else self.numbers["environment.density"]

    def rotor_commands(self, channels: Mapping[str, Any]) -> dict[str, Any]:
        """Return the commanded x of each rotor, before the lag."""
        return forces.rotor_commands(self.numbers, channels)

    def spin_rates(self, states: Mapping[str, Any], channels: Mapping[str, Any]) -> dict[str, Any]:
        """Return the rate of x of each rotor where it acts on the body."""
        return forces.spins(self.numbers, states, channels)[1]

    def thrust(self, V: Any, density: Any, channels: Mapping[str, Any]) -> Any:
        """Return the thrust of the propulsion at an airspeed."""
        air = Air(V, V**2, *[NULL] * 6)
        return forces.thrust(forces.Surroundings(self.numbers, air, density, (NULL,) * 3, {}, channels))

    def load(self, velocity: Vector, **others: Any) -> forces.Load:
        """Return force and moment about the center of gravity; `others` are fields of `forces.Surroundings`."""
        air = airflow(self.vehicle, velocity)
        return forces.total(forces.Surroundings(self.numbers, air, velocity=velocity, **others))

    def readings(
        self, quaternion: Quaternion, velocity: Vector, omega: Vector, omega_rate: Vector, specific: Vector
    ) -> dict[str, Any]:
        """Return the readings of the instruments in still air, by channel; `specific` is the specific force."""
        observed = frames.air_data(self.numbers, quaternion, velocity, omega, frames.air(velocity).V)
        observed |= dict(zip(("vn", "ve", "vd"), frames.over_ground(quaternion, velocity), strict=True))
        observed = {c: reading for c, reading in observed.items() if c in self.vehicle.outputs}
        return readings(self.numbers, observed, frames.attitude(quaternion), specific, omega, omega_rate)
