"""What only ratios to the mass can tell of a vehicle with rotors.

A flight sees accelerations. Where neither mass nor inertia nor any force is known beforehand, all of them may be
multiplied by one number and nothing that was measured changes: thrust per mass is told, thrust is not. The mass is then
held at the file's value, and what stands beside it is a ratio.
"""

from __future__ import annotations

from typing import Any, Final

from stoop.vehicle import Parameter, Vehicle
from stoop.vehicle.defaults import ROTOR_AERODYNAMICS

MASS: Final = "mass.mass"
_FORCES: Final = ROTOR_AERODYNAMICS - {"rotors.torque_ratio"} | {"rotors.inertia"}


def in_ratio(vehicle: Vehicle) -> tuple[Parameter, ...]:
    """Return the free numbers that are known in ratio to the mass only; none where something tells the mass."""
    if not vehicle.rotors or vehicle.file.propulsion is not None or any(vehicle.terms.values()):
        return ()
    group = [p for p in vehicle.parameters if _scales(p.name)]
    fixed = [p for p in group if p.value != 0.0 and (not p.free or p.prior is not None)]
    mass = vehicle.parameters[vehicle.rows[MASS]]
    if fixed or (mass.free and mass.prior is not None):
        return ()
    return tuple(p for p in group if p.free)


def with_mass_held(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle with its mass held where it could be anything."""
    mass = vehicle.parameters[vehicle.rows[MASS]]
    if not mass.free or not in_ratio(vehicle):
        return vehicle
    held: dict[str, dict[str, Any]] = {MASS: {"free": False}}
    return vehicle.with_numbers(held)


def ratios(vehicle: Vehicle, estimates: dict[str, tuple[float, float]]) -> str:
    """Return in words the numbers per kg of mass; empty where the mass matters.

    Parameters
    ----------
    vehicle : Vehicle
        As it was fitted.
    estimates : dict
        Name -> estimate and its standard error, SI.
    """
    named = [p for p in in_ratio(vehicle) if p.name in estimates]
    if not named:
        return ""
    mass = vehicle.value(MASS)
    each = ", ".join(
        f"{p.name} {estimates[p.name][0] / mass:.4g} +/- {estimates[p.name][1] / mass:.2g} {p.unit}/kg"
        for p in named
    )
    return (
        f"Only ratios to the mass are told, for no mass, inertia or force is known beforehand: {MASS} was held at {mass:g} kg. "
        f"Per kg: {each}. Another mass multiplies all of them; weigh the vehicle and write mass.mass, or give inertia a prior."
    )


def _scales(name: str) -> bool:
    return name in _FORCES or name.startswith(("body_drag.", "mass.inertia."))
