"""Whether flights and vehicle file are of one vehicle: what drives it, what carries it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from stoop.errors import FlightError
from stoop.estimate.motors_swapped import swapped_motors
from stoop.estimate.rotors_seen import strange_motors
from stoop.flight import Flight
from stoop.flight.airborne import carried_by_rotors, flying, lift_command
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle

DRIVEN: Final = (
    "elevator",
    "aileron",
    "rudder",
    "flap",
    "control_",
    "motor_",
    "servo_",
    "pwm_",
    "rotor_",
    "thr",
)
WRONG: Final = ("wrong unit", "wrong sign")  #: faults of a mapping, which hold wherever the channel is read
UNLIKE: Final = 0.25  #: difference of the usual lift commands of two flights, over their mean


def check_inputs(vehicle: Vehicle, flight: Flight, named_by: str = "--vehicle") -> None:
    """Refuse a flight that lacks what drives the vehicle.

    Parameters
    ----------
    named_by : str
        What the user is to check: the vehicle was named by it.

    Raises
    ------
    FlightError
        Names the channels, what the flight has instead, and what to change.
    """
    missing = [name for name in vehicle.recorded if name not in flight.data]
    if not missing:
        _check_numbers(vehicle, flight)
        return
    there = [str(name) for name in flight.data.data_vars if str(name).startswith(DRIVEN)]
    other = ""
    if vehicle.rotors and not carried_by_rotors(flight):
        other = f"{vehicle.where} flies on rotors, but no rotors are in this log: is it of another vehicle? "
    elif carried_by_rotors(flight) and not vehicle.rotors:
        other = (
            f"rotors carry the vehicle of this log, but {vehicle.where} has none: is it of another vehicle? "
        )
    elif vehicle.rotors:
        rotors = [r for r, rotor in vehicle.file.rotor.items() if rotor.channel in missing]
        tables = f", or channel in {', '.join(f'[rotor.{r}]' for r in rotors)}" if rotors else ""
        other = (
            f"{vehicle.where} has {len(vehicle.rotors)} rotors: is this the log of another vehicle{tables}? "
        )
    raise FlightError(
        f"{flight.name}: input {', '.join(repr(name) for name in missing)} is not in this flight, which is driven by "
        f"{', '.join(there) or 'nothing that was recorded'}; {other}check {named_by}, the channels in it, or the mapping"
    )


def _check_numbers(vehicle: Vehicle, flight: Flight) -> None:
    empty = [name for name in vehicle.recorded if not np.isfinite(flight.column(name)).any()]
    if empty:
        raise FlightError(
            f"{flight.name}: input {', '.join(repr(name) for name in empty)} holds no number throughout; look at the "
            "column that the mapping names for it, and at what the autopilot logs"
        )


def doubts(vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window]) -> list[str]:
    """Say in words what speaks against this vehicle in these windows; quick, and worth saying before any search.

    Raises
    ------
    FlightError
        A flight lacks what drives the vehicle: then nothing else needs saying.
    """
    for name in dict.fromkeys(w.flight for w in windows):
        check_inputs(vehicle, flights[name])
    return [
        *strange_motors(vehicle, flights, windows),
        *swapped_motors(vehicle, flights, windows),
        *_wrong_units(vehicle, flights),
        *unlike(vehicle, flights),
    ]


def _wrong_units(vehicle: Vehicle, flights: Mapping[str, Flight]) -> list[str]:
    read = {*vehicle.outputs, *vehicle.recorded}
    return [
        f"{flight.name}: {fault.message}."
        for flight in flights.values()
        for fault in flight.faults
        if fault.kind in WRONG and fault.variable in read
    ]


def unlike(vehicle: Vehicle, flights: Mapping[str, Flight]) -> list[str]:
    """Say in words why a flight is hardly of this vehicle, or two flights of one."""
    carried = {name: carried_by_rotors(flight) for name, flight in flights.items()}
    out = [
        f"{name}: rotors carry the vehicle of this log, but {vehicle.where} has none: is it of another vehicle? Check --vehicle."
        for name, on_rotors in carried.items()
        if on_rotors and not vehicle.rotors
    ]
    levels = {
        name: _level(flights[name]) for name, on_rotors in carried.items() if on_rotors and vehicle.rotors
    }
    known = {name: level for name, level in levels.items() if level > 0.0}
    if len(known) > 1:
        low, high = min(known, key=lambda n: known[n]), max(known, key=lambda n: known[n])
        if known[high] - known[low] > UNLIKE * 0.5 * (known[high] + known[low]):
            out.append(
                f"{low} is carried by {known[low]:.2f} of full command and {high} by {known[high]:.2f}: another mass, other "
                "propellers or another vehicle; fit them apart, or name the mass that was flown: START:STOP#LOADING."
            )
    return out


def _level(flight: Flight) -> float:
    """Return the usual command that carries a vehicle; zero where nothing says."""
    told = lift_command(flight)
    if told is None:
        return 0.0
    seen = told[flying(flight) & np.isfinite(told)]
    return float(np.median(seen)) if seen.size else 0.0
