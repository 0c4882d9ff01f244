"""Whether flights and a vehicle file are of one vehicle: what drives it, what carries it, what it weighs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from stoop.base.notices import Notice, attempt, notice
from stoop.base.packages import hooks
from stoop.checks.rotors import KINDS
from stoop.errors import FlightError
from stoop.flight import Flight
from stoop.problem import Piece
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle
from stoop.vehicle.checks import principal_moments
from stoop.vehicle.usual import ROTORS_ONLY, WINGED

#: beginnings of channels that drive a vehicle
DRIVES: Final = (
    "elevator", "aileron", "rudder", "flap", "control_", "motor_", "servo_", "pwm_", "rotor_", "thr",
)  # fmt: skip
ROUNDING: Final = 1e-9


def check_vehicle(
    vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window] = ()
) -> list[Notice]:
    """Return what speaks against this vehicle in these windows, or in whole flights; quick, and worth knowing before any search.

    Raises FlightError when a flight lacks what drives the vehicle: then nothing else needs saying.
    """
    for name in dict.fromkeys(w.flight for w in windows) or flights:
        require_channels(vehicle, flights[name])
    used = {*vehicle.outputs, *vehicle.recorded}
    faults = ((flight.name, one) for flight in flights.values() for one in flight.faults)
    wrong = [(n, x) for n, x in faults if x.variable in used and x.kind in ("wrong unit", "wrong sign")]
    mapping = [notice("sensor-fault", name, fault=one.message) for name, one in wrong]
    failed: list[Notice] = []
    lift = attempt(failed, [], check_lift, vehicle, flights)
    return [*check_rotors(vehicle, flights, windows), *mapping, *lift, *failed]


def check_rotors(vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window]) -> list[Notice]:
    """Return what the motors of flights, and the windows that were chosen, say against a vehicle file."""
    taken, kind = windows or Window.whole(flights), KINDS[vehicle.frame]
    by_flight = {w.flight: [x for x in taken if x.flight == w.flight] for w in taken}
    checks = (*kind.motors, *hooks("check_motors", list[Notice]), *(kind.windows if windows else ()))
    found: list[Notice] = []
    for detector in checks:
        for name, own in by_flight.items():
            found += attempt(found, [], detector, vehicle, flights[name], own)
    return found


def check_lift(vehicle: Vehicle, flights: Mapping[str, Flight]) -> list[Notice]:
    """Return why a flight is hardly of this vehicle, or two flights of one."""
    carried = {name: flight for name, flight in flights.items() if flight.carried_by_rotors()}
    return KINDS[vehicle.frame].lift(vehicle, carried)


def require_channels(vehicle: Vehicle, flight: Flight, named_by: str = "--vehicle") -> None:
    """Refuse a flight that lacks what drives the vehicle.

    Parameters
    ----------
    vehicle : Vehicle
    flight : Flight
    named_by : str
        What the user is to check: the vehicle was named by it.

    Raises
    ------
    FlightError
        Names the channels, what the flight has instead, and what to change.
    """
    missing = [name for name in vehicle.recorded if name not in flight.names]
    if missing:
        there = [str(name) for name in flight.channels if str(name).startswith(DRIVES)]
        other = KINDS[vehicle.frame].other_vehicle(vehicle, missing, flight.carried_by_rotors())
        raise FlightError(
            f"{flight.name}: input {', '.join(repr(name) for name in missing)} is not in this flight, whose inputs are "
            f"{', '.join(there) or 'not recorded'}; {other}check {named_by}, "
            "the channels in it, or the mapping"
        )
    empty = [name for name in vehicle.recorded if not np.isfinite(flight.column(name)).any()]
    if empty:
        raise FlightError(
            f"{flight.name}: input {', '.join(repr(name) for name in empty)} holds no number throughout; look at the "
            "column that the mapping names for it, and at what the autopilot logs"
        )


def require_data(vehicle: Vehicle, windows: Sequence[Window], pieces: Sequence[Piece]) -> None:
    """Refuse windows that determine nothing of a vehicle: IdentificationError."""
    for refuse in KINDS[vehicle.frame].data:
        refuse(vehicle, windows, pieces)


def inertia_notices(vehicle: Vehicle, estimates: Mapping[str, float] | None = None) -> list[Notice]:
    """Challenge moments of inertia: the file's as those of a body, and by their radii of gyration over the span or the rotors.

    About the roll axis even a wing that carries all mass evenly over its span has 0.29. Estimates replace numbers of the
    file, by name.
    """

    def value(name: str) -> float:
        return (estimates or {}).get(name, vehicle.value(name))

    if vehicle.file.reference is not None:
        length, unit, usual_radii = value("reference.span"), "spans", WINGED
    else:
        hubs = [f"rotor.{name}.position" for name in vehicle.rotors]
        places = [[vehicle.value(f"{hub}.{axis}") for axis in "xyz"] for hub in hubs]
        length = max((math.dist(a, b) for a in places for b in places), default=0.0)
        unit, usual_radii = "of the largest distance between rotors", ROTORS_ONLY
    mass, out = value("mass.mass"), []
    for axis, known in usual_radii.items() if length > 0.0 and mass > 0.0 else ():
        name = f"mass.inertia.{axis}"
        moment = value(name)
        radius = math.sqrt(max(moment, 0.0) / mass) / length
        if not known.least <= radius <= known.most:
            usual = mass * (length * 0.5 * (known.low + known.high)) ** 2
            code = f"inertia-{'large' if moment > usual else 'small'}"
            values = {"inertia": moment, "radius": radius, "usual": usual}
            out.append(notice(code, name, **values, low=known.low, high=known.high, unit=unit))
    small, middle, large = principal_moments(vehicle)
    if (excess := large / (small + middle) - 1.0) > ROUNDING:
        values = {"largest": large, "others": small + middle, "excess": excess}
        out.append(notice("inertia-of-no-body", "mass.inertia", **values))
    return out
