"""Why a flight has no window to fit, in words, with what to change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from stoop.base.variables import RATES
from stoop.errors import FlightError, listed
from stoop.estimate.mismatch import check_inputs
from stoop.flight import Flight
from stoop.flight.airborne import flying, lift_command, motors_ran
from stoop.flight.maneuvers import commands
from stoop.vehicle import Vehicle

NAMED: Final = 3


def require_commands(flight: Flight) -> None:
    """Refuse a flight without rates, or without anything that commands them.

    Raises
    ------
    FlightError
        With what to record or to map.
    """
    missing = [rate for rate in RATES if not _recorded(flight, rate)]
    if missing:
        raise FlightError(
            f"{flight.name}: {', '.join(missing)} {'was' if len(missing) == 1 else 'were'} not recorded, and without "
            "body rates no maneuver shows; log the gyros, or name their columns in a mapping ([variables] p, q, r)"
        )
    if not motors_ran(flight):
        raise FlightError(f"{flight.name}: {motors_off(flight)}")
    if not commands(flight):
        raise FlightError(
            f"{flight.name}: no command was recorded that moves (surfaces, control_roll/pitch/yaw, motor_n, servo_n, "
            "pwm_n); log them, or name their columns in a mapping (stoop map drafts one)"
        )


def require_inputs(flight: Flight, vehicle: Vehicle) -> None:
    """Refuse a flight that lacks what drives the vehicle's equations.

    Raises
    ------
    FlightError
        Names the channels.
    """
    check_inputs(vehicle, flight)
    if vehicle.rotors and not motors_ran(flight):
        raise FlightError(f"{flight.name}: {motors_off(flight)}")


def motors_off(flight: Flight) -> str:
    """Say that no rotor was ever told to turn."""
    told = lift_command(flight)
    most = 0.0 if told is None else float(np.nanmax(np.append(told, 0.0)))
    return (
        f"the motors never ran (their commands reach {100.0 * most:.0f} % at most): nothing flew in this log; "
        "give a log of a flight, or check the scale of the motor channels in the mapping"
    )


def nothing_found(flights: Mapping[str, Flight], vehicle: Vehicle | None) -> FlightError:
    """Return the error for flights in which no window can be used."""
    name, flight = next(iter(flights.items()))
    up = float(flying(flight).sum()) / flight.rate
    if up < 2.0:
        return FlightError(
            f"{name}: the vehicle is in the air for {up:.1f} s only, as far as speed and commands tell; give a log of a "
            "flight, or name windows yourself: --maneuver START:STOP"
        )
    need = f" ({', '.join(vehicle.recorded)})" if vehicle is not None else ""
    return FlightError(
        f"{name}: no {'window' if vehicle is None else 'window in which the inputs' + need} "
        f"{'moves the vehicle out of the usual' if vehicle is None else 'and the state were measured tells anything'}; "
        "fly doublets about each axis (stoop design proposes them), or name windows yourself: --maneuver START:STOP"
    )


def no_maneuver(flights: Mapping[str, Flight], untold: Sequence[str], free: int) -> FlightError:
    """Return the error for flights in which nobody moved anything: windows there are, but they tell next to nothing."""
    known = f", and {len(untold)} of {free} free numbers would not be known to their own size ({listed(untold, NAMED)})"
    return FlightError(
        f"{', '.join(flights)}: no maneuver here: no command moves out of the usual{known if untold else ''}; fly doublets "
        "about each axis (stoop design proposes them), or name windows yourself: --maneuver START:STOP"
    )


def _recorded(flight: Flight, name: str) -> bool:
    return name in flight.data and bool(np.isfinite(flight.column(name)).any())
