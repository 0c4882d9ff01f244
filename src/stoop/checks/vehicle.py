"""Whether flights and a vehicle file are of one vehicle: what drives it, what carries it, what it weighs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray
from stoop.base.notices import Notice, notice
from stoop.checks.kinematics import check_motion, check_rates
from stoop.checks.motors import check_motors
from stoop.errors import FlightError
from stoop.flight import Flight
from stoop.flight.airborne import carried_by_rotors, flying, lift_command
from stoop.problem.windows import Window, whole, within
from stoop.vehicle import Vehicle

DRIVES: Final = (
    "elevator", "aileron", "rudder", "flap", "control_", "motor_", "servo_", "pwm_", "rotor_", "thr",
)  #: beginnings of channels that drive a vehicle  # fmt: skip
MAPPING_FAULTS: Final = ("wrong unit", "wrong sign")  #: faults that hold wherever the channel is read
LIFT_DIFFERENCE: Final = 0.25  #: of the usual lift commands of two flights, over their mean
ROTOR_CHANNELS: Final = ("motor", "rotor")  #: kinds of channels that turn a rotor and nothing else
#: times the rotors' scatter, by which an output may lie beside them, and scatter more or less, to be taken for a rotor's
OUTPUT_LIKENESS: Final = 3.0


@dataclass(frozen=True)
class Gyration:
    """Radii of gyration about one axis, over the length of the vehicle.

    Attributes
    ----------
    least, most : outside of which hardly any aircraft lies
    low, high : of usual aircraft
    """

    least: float
    most: float
    low: float
    high: float


#: over the span; at most a uniform rod, a flying wing or a long fuselage, at least all mass near the middle. Usual: half of
#: the nondimensional radii of Raymer, "Aircraft Design: A Conceptual Approach", table of radii of gyration
WINGED: Final = {
    "xx": Gyration(0.05, 1.0 / math.sqrt(12.0), 0.11, 0.17),
    "yy": Gyration(0.03, 0.5, 0.1, 0.25),
    "zz": Gyration(0.08, 0.55, 0.17, 0.27),
}
#: over the largest distance between rotors; at most all mass is in the motors
ROTORS_ONLY: Final = {
    "xx": Gyration(0.07, 0.4, 0.18, 0.3),
    "yy": Gyration(0.07, 0.4, 0.18, 0.3),
    "zz": Gyration(0.1, 0.55, 0.25, 0.42),
}


def check(flight: Flight, vehicle: Vehicle | None = None) -> tuple[Notice, ...]:
    """Return what contradicts a flight, its mapping or the file of its vehicle.

    Parameters
    ----------
    flight : Flight
    vehicle : Vehicle, optional
        Also held against the flight, all of it.

    Raises
    ------
    FlightError
        The flight lacks what drives the vehicle.
    """
    data = {str(name): flight.column(str(name)) for name in flight.data.data_vars}
    wrong, corrected = check_motion(data, flight.rate, {})
    known = {fault.variable for fault in flight.faults}
    found = [one for one in (*wrong, *check_rates(corrected, flight.rate, {})) if one.subject not in known]
    out = [*(fault.notice for fault in flight.faults), *found]
    if vehicle is not None:
        flights = {flight.name: flight}
        out += [one for one in check_vehicle(vehicle, flights, whole(flights)) if one not in out]
        out += inertia_notices(vehicle)
    return tuple(out)


def check_vehicle(vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window]) -> list[Notice]:
    """Return what speaks against this vehicle in these windows; quick, and worth knowing before any search.

    Raises
    ------
    FlightError
        A flight lacks what drives the vehicle: then nothing else needs saying.
    """
    for name in dict.fromkeys(w.flight for w in windows):
        require_channels(vehicle, flights[name])
    used = {*vehicle.outputs, *vehicle.recorded}
    mapping = [
        notice("sensor-fault", flight.name, fault=fault.message)
        for flight in flights.values()
        for fault in flight.faults
        if fault.kind in MAPPING_FAULTS and fault.variable in used
    ]
    return [*check_rotors(vehicle, flights, windows), *mapping, *check_lift(vehicle, flights)]


def check_rotors(vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window]) -> list[Notice]:
    """Return what the motors of flights say against the rotors of a vehicle file."""
    if not vehicle.rotors:
        return []
    by_flight = {
        name: [w for w in windows if w.flight == name] for name in dict.fromkeys(w.flight for w in windows)
    }
    foreign = [one for name, own in by_flight.items() for one in foreign_motors(vehicle, flights[name], own)]
    return [
        *foreign,
        *(n for name, own in by_flight.items() for n in check_motors(vehicle, flights[name], own)),
    ]


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
    missing = [name for name in vehicle.recorded if name not in flight.data]
    empty = [
        name
        for name in vehicle.recorded
        if name not in missing and not np.isfinite(flight.column(name)).any()
    ]
    if missing:
        there = [str(name) for name in flight.data.data_vars if str(name).startswith(DRIVES)]
        raise FlightError(
            f"{flight.name}: input {', '.join(repr(name) for name in missing)} is not in this flight, which is driven by "
            f"{', '.join(there) or 'nothing that was recorded'}; {_other_vehicle(vehicle, flight, missing)}check {named_by}, "
            "the channels in it, or the mapping"
        )
    if empty:
        raise FlightError(
            f"{flight.name}: input {', '.join(repr(name) for name in empty)} holds no number throughout; look at the "
            "column that the mapping names for it, and at what the autopilot logs"
        )


def _other_vehicle(vehicle: Vehicle, flight: Flight, missing: Sequence[str]) -> str:
    """Ask whether the flight is of another vehicle, where rotors show it."""
    on_rotors = carried_by_rotors(flight)
    if vehicle.rotors and not on_rotors:
        return f"{vehicle.where} flies on rotors, but no rotors are in this log: is it of another vehicle? "
    if on_rotors and not vehicle.rotors:
        return (
            f"rotors carry the vehicle of this log, but {vehicle.where} has none: is it of another vehicle? "
        )
    if vehicle.rotors:
        rotors = [f"[rotor.{name}]" for name, rotor in vehicle.file.rotor.items() if rotor.channel in missing]
        tables = f", or channel in {', '.join(rotors)}" if rotors else ""
        return (
            f"{vehicle.where} has {len(vehicle.rotors)} rotors: is this the log of another vehicle{tables}? "
        )
    return ""


def check_lift(vehicle: Vehicle, flights: Mapping[str, Flight]) -> list[Notice]:
    """Return why a flight is hardly of this vehicle, or two flights of one."""
    out, levels = [], {}
    for name, flight in flights.items():
        if carried_by_rotors(flight) and not vehicle.rotors:
            out.append(notice("flight-on-rotors", name, vehicle=vehicle.where))
        elif vehicle.rotors and (level := _lift_level(flight)) > 0.0:
            levels[name] = level
    if len(levels) > 1:
        low, high = min(levels, key=lambda n: levels[n]), max(levels, key=lambda n: levels[n])
        if levels[high] - levels[low] > LIFT_DIFFERENCE * 0.5 * (levels[high] + levels[low]):
            out.append(notice("lift-differs", low, level=levels[low], other=high, other_level=levels[high]))
    return out


def _lift_level(flight: Flight) -> float:
    """Return the usual command that carries a vehicle; zero where none is known."""
    command = lift_command(flight) if carried_by_rotors(flight) else None
    if command is None:
        return 0.0
    known = command[flying(flight) & np.isfinite(command)]
    return float(np.median(known)) if known.size else 0.0


def foreign_motors(vehicle: Vehicle, flight: Flight, windows: Sequence[Window]) -> list[Notice]:
    """Return which motors of a log move though no rotor of the vehicle has them."""
    channels = tuple(_foreign(vehicle, flight, within(flight, windows)))
    return (
        [notice("foreign-motors", flight.name, channels=channels, vehicle=vehicle.where)] if channels else []
    )


def _foreign(vehicle: Vehicle, flight: Flight, inside: BoolArray) -> Iterator[str]:
    """Yield channels of the rotors' kind that no rotor has: motors that move, and outputs that move as the rotors' do."""
    own = {rotor.channel for rotor in vehicle.file.rotor.values()}
    there = [str(name) for name in flight.data.data_vars]
    kinds = {channel.rpartition("_")[0] for channel in own}
    usual = np.array([_level(flight.column(c)[inside]) for c in own if c in there]).reshape(-1, 2)
    for channel in there:
        kind = channel.rpartition("_")[0]
        if channel in own or channel in vehicle.recorded or kind not in kinds:
            continue
        middle, spread = _level(flight.column(channel)[inside])
        if spread > 0.0 and (kind in ROTOR_CHANNELS or _is_alike(middle, spread, usual)):
            yield channel


def _is_alike(middle: float, spread: float, usual: FloatArray) -> bool:
    """Tell whether an output, which may move a surface as well, is where rotors are, and moves as much."""
    middles, scatter = usual[:, 0], float(np.median(usual[:, 1]))
    near = OUTPUT_LIKENESS * scatter
    inside = middles.min() - near <= middle <= middles.max() + near
    return bool(inside and 1.0 / OUTPUT_LIKENESS < spread / max(scatter, 1e-12) < OUTPUT_LIKENESS)


def _level(x: FloatArray) -> tuple[float, float]:
    """Return the median of a channel, and how far it scatters; zeros where it was not recorded."""
    known = x[np.isfinite(x)]
    if not known.size or np.ptp(known) == 0.0:  # rounding gives what is constant a scatter
        return (float(known[0]) if known.size else 0.0), 0.0
    return float(np.median(known)), float(np.std(known))


def inertia_notices(vehicle: Vehicle, estimates: Mapping[str, float] | None = None) -> list[Notice]:
    """Challenge moments of inertia by their radii of gyration over the span, or over the distance between rotors.

    About the roll axis even a wing that carries all mass evenly over its span has 0.29.

    Parameters
    ----------
    vehicle : Vehicle
    estimates : mapping, optional
        Numbers that replace those of the file, by name.
    """
    given = estimates or {}
    mass = given.get("mass.mass", vehicle.value("mass.mass"))
    winged = vehicle.file.reference is not None
    length = (
        given.get("reference.span", vehicle.value("reference.span")) if winged else rotor_distance(vehicle)
    )
    out = []
    for axis, known in (WINGED if winged else ROTORS_ONLY).items() if length > 0.0 else ():
        name = f"mass.inertia.{axis}"
        moment = given.get(name, vehicle.value(name))
        radius = math.sqrt(max(moment, 0.0) / mass) / length
        if not known.least <= radius <= known.most:
            usual = mass * (length * 0.5 * (known.low + known.high)) ** 2
            out.append(
                notice(
                    f"inertia-{'large' if moment > usual else 'small'}",
                    name,
                    inertia=moment,
                    radius=radius,
                    unit="spans" if winged else "of the largest distance between rotors",
                    low=known.low,
                    high=known.high,
                    usual=usual,
                )
            )
    return out


def rotor_distance(vehicle: Vehicle) -> float:
    """Return the largest distance between two rotors, m; zero for fewer than two."""
    places = [[vehicle.value(f"rotor.{name}.position.{axis}") for axis in "xyz"] for name in vehicle.rotors]
    return max((math.dist(a, b) for a in places for b in places), default=0.0)
