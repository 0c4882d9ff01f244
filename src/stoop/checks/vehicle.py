"""Whether flights and a vehicle file are of one vehicle, and whether windows of rotor flight tell anything of it.

What drives it, what carries it, what it weighs; motors off, saturated, or still; no rates.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.variables import RATES
from stoop.checks.kinematics import check_motion, check_rates
from stoop.checks.motors import check_motors
from stoop.errors import FlightError, IdentificationError
from stoop.flight import Flight
from stoop.flight.airborne import carried_by_rotors, flying, lift_command
from stoop.problem import Misfit, Piece
from stoop.problem.windows import Window, whole, within
from stoop.simulation import parameter_rows
from stoop.simulation.initial import commanded
from stoop.simulation.rotors import channel_range
from stoop.vehicle import Vehicle

DRIVES: Final = (
    "elevator", "aileron", "rudder", "flap", "control_", "motor_", "servo_", "pwm_", "rotor_", "thr",
)  #: beginnings of channels that drive a vehicle  # fmt: skip
AXES: Final = dict(zip(RATES, (("roll", "xx"), ("pitch", "yy"), ("yaw", "zz")), strict=True))


@dataclass(frozen=True)
class Gyration:
    """Radii of gyration about one axis, over the length of the vehicle."""

    least: float  #: outside of `least` and `most` hardly any aircraft lies
    most: float
    low: float  #: `low` and `high` are of usual aircraft
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


@dataclass(frozen=True)
class Limits:
    """What makes windows of rotor flight useless or doubtful, and flights those of another vehicle."""

    lift: float = 0.25  #: of the usual lift commands of two flights, over their mean, by which they differ
    #: times the rotors' scatter, by which an output may lie beside them, and scatter more or less, to be taken for a rotor's
    likeness: float = 3.0
    off: float = 0.1  #: of the largest x of all rotors, below which a rotor carries nothing
    off_share: float = 0.02  #: of a window with the motors off, that is reported
    ground_share: float = 0.5  #: of a window with the motors off, that leaves nothing to fit
    end: float = 1e-6  #: of the range of a channel
    limit_share: float = 0.02  #: of a window at a limit, that is reported
    values: int = 20  #: different values of a command that is no switch
    contrast: int = 5  #: times as many samples at a plateau as at the value next to it
    lift_change: float = 0.01  #: of the mean x: the rms of a change that is an input
    burst: float = 2.0  #: s: about as long as a pulse or a doublet lasts
    motion: float = 3.0  #: times the noise of the file: a rate that moves


LIMITS: Final = Limits()


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

    Raises FlightError when a flight lacks what drives the vehicle: then nothing else needs saying.
    """
    for name in dict.fromkeys(w.flight for w in windows):
        require_channels(vehicle, flights[name])
    used = {*vehicle.outputs, *vehicle.recorded}
    mapping = [
        notice("sensor-fault", flight.name, fault=fault.message)
        for flight in flights.values()
        for fault in flight.faults
        if fault.kind in ("wrong unit", "wrong sign") and fault.variable in used
    ]
    return [*check_rotors(vehicle, flights, windows), *mapping, *check_lift(vehicle, flights)]


def check_rotors(vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window]) -> list[Notice]:
    """Return what the motors of flights say against the rotors of a vehicle file."""
    if not vehicle.rotors:
        return []
    by_flight: dict[str, list[Window]] = {}
    for window in windows:
        by_flight.setdefault(window.flight, []).append(window)
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
    if missing:
        there = [str(name) for name in flight.data.data_vars if str(name).startswith(DRIVES)]
        on_rotors, other = carried_by_rotors(flight), ""
        if vehicle.rotors and not on_rotors:
            other = f"{vehicle.where} flies on rotors, but this log has no rotors: does it belong to another vehicle? "
        elif on_rotors and not vehicle.rotors:
            other = (
                f"the vehicle of this log is carried by rotors, but {vehicle.where} has none: is it another? "
            )
        elif vehicle.rotors:
            rotors = _tables(vehicle, missing)
            tables = f", or channel in {rotors}" if rotors else ""
            other = f"{vehicle.where} has {len(vehicle.rotors)} rotors: does the log belong to another vehicle{tables}? "
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


def _tables(vehicle: Vehicle, channels: Sequence[str]) -> str:
    """Name the tables of the rotors that these channels drive."""
    rotors = vehicle.file.rotor.items()
    return ", ".join(f"[rotor.{name}]" for name, rotor in rotors if rotor.channel in channels)


def check_lift(vehicle: Vehicle, flights: Mapping[str, Flight]) -> list[Notice]:
    """Return why a flight is hardly of this vehicle, or two flights of one."""
    out, levels = [], {}
    for name, flight in flights.items():
        if not carried_by_rotors(flight):
            continue
        if not vehicle.rotors:
            out.append(notice("flight-on-rotors", name, vehicle=vehicle.where))
            continue
        command = lift_command(flight)  # that usually carries it
        known = np.empty(0) if command is None else command[flying(flight) & np.isfinite(command)]
        if known.size and (level := float(np.median(known))) > 0.0:
            levels[name] = level
    if len(levels) > 1:
        low, high = min(levels, key=lambda n: levels[n]), max(levels, key=lambda n: levels[n])
        if levels[high] - levels[low] > LIMITS.lift * 0.5 * (levels[high] + levels[low]):
            out.append(notice("lift-differs", low, level=levels[low], other=high, other_level=levels[high]))
    return out


def foreign_motors(vehicle: Vehicle, flight: Flight, windows: Sequence[Window]) -> list[Notice]:
    """Return which motors of a log move though no rotor of the vehicle has them.

    An output, which may move a surface as well, is one where it lies where the rotors' are, and moves as much.
    """
    inside = within(flight, windows)

    def level(channel: str) -> tuple[float, float]:
        """Return the median of a channel, and how far it scatters; zeros where it was not recorded."""
        x = flight.column(channel)[inside]
        known = x[np.isfinite(x)]
        if not known.size or np.ptp(known) == 0.0:  # rounding gives what is constant a scatter
            return (float(known[0]) if known.size else 0.0), 0.0
        return float(np.median(known)), float(np.std(known))

    own = {rotor.channel for rotor in vehicle.file.rotor.values()}
    there = [str(name) for name in flight.data.data_vars]
    kinds = {channel.rpartition("_")[0] for channel in own}
    usual = np.array([level(c) for c in own if c in there]).reshape(-1, 2)
    channels = []
    for channel in there:
        kind = channel.rpartition("_")[0]
        if channel in own or channel in vehicle.recorded or kind not in kinds:
            continue
        middle, spread = level(channel)
        if spread > 0.0 and kind not in ("motor", "rotor"):
            middles, scatter = usual[:, 0], float(np.median(usual[:, 1]))
            near = LIMITS.likeness * scatter
            inner = middles.min() - near <= middle <= middles.max() + near
            alike = inner and 1.0 / LIMITS.likeness < spread / max(scatter, 1e-12) < LIMITS.likeness
            spread = spread if alike else 0.0
        if spread > 0.0:
            channels.append(channel)
    found = notice("foreign-motors", flight.name, channels=tuple(channels), vehicle=vehicle.where)
    return [found] if channels else []


def inertia_notices(vehicle: Vehicle, estimates: Mapping[str, float] | None = None) -> list[Notice]:
    """Challenge moments of inertia by their radii of gyration over the span, or over the distance between rotors.

    About the roll axis even a wing that carries all mass evenly over its span has 0.29. Estimates replace numbers of the
    file, by name.
    """

    def value(name: str) -> float:
        return (estimates or {}).get(name, vehicle.value(name))

    if vehicle.file.reference is not None:
        length, unit, usual_radii = value("reference.span"), "spans", WINGED
    else:
        places = [
            [vehicle.value(f"rotor.{name}.position.{axis}") for axis in "xyz"] for name in vehicle.rotors
        ]
        length = max((math.dist(a, b) for a in places for b in places), default=0.0)
        unit, usual_radii = "of the largest distance between rotors", ROTORS_ONLY
    mass, out = value("mass.mass"), []
    for axis, known in usual_radii.items() if length > 0.0 else ():
        name = f"mass.inertia.{axis}"
        moment = value(name)
        radius = math.sqrt(max(moment, 0.0) / mass) / length
        if not known.least <= radius <= known.most:
            usual = mass * (length * 0.5 * (known.low + known.high)) ** 2
            code = f"inertia-{'large' if moment > usual else 'small'}"
            values = {
                "inertia": moment,
                "radius": radius,
                "low": known.low,
                "high": known.high,
                "usual": usual,
            }
            out.append(notice(code, name, **values, unit=unit))
    return out


def require_rotors(vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window]) -> None:
    """Refuse a log that lacks some of the motors: most often that of another vehicle.

    Raises
    ------
    FlightError
        Some, but not all, of the rotors' channels are missing.
    """
    for name in dict.fromkeys(w.flight for w in windows):
        missing = [r.channel for r in vehicle.file.rotor.values() if r.channel not in flights[name].data]
        if missing and len(missing) < len(vehicle.rotors):
            raise FlightError(
                f"{name}: no {', '.join(dict.fromkeys(missing))} in this log, but {vehicle.where} has "
                f"{len(vehicle.rotors)} rotors; is it the log of another vehicle? Check --vehicle, or channel in "
                f"{_tables(vehicle, missing)}"
            )


def require_rotor_data(vehicle: Vehicle, windows: Sequence[Window], pieces: Sequence[Piece]) -> None:
    """Refuse windows that tell nothing.

    Raises
    ------
    IdentificationError
        No rates, motors off, or channels that are no rotor's.
    """
    columns = [vehicle.outputs.index(c) for c in RATES]
    for piece in pieces:
        if not np.isfinite(piece.measured[:, columns]).any():
            raise IdentificationError(
                f"{windows[piece.maneuver]}: none of the rates p, q, r was recorded, and without them nothing tells moments "
                "or lag; log the gyroscope, or name its columns in the mapping file ([variables] p = ..., see stoop map)"
            )
        off = _off(vehicle, piece)
        if off.mean() > LIMITS.ground_share:
            raise IdentificationError(
                f"{windows[piece.maneuver]}: the motors are off in {off.mean():.0%} of it, so it is no flight; choose "
                "--maneuver START:STOP where they carry the vehicle (stoop maneuvers), and check rotors.idle and rotors.gain "
                f"in {vehicle.where}"
            )
    names = sorted({rotor.channel for rotor in vehicle.file.rotor.values()})
    moved = {n: max(float(np.ptp(p.inputs[:, vehicle.inputs.index(n)])) for p in pieces) for n in names}
    still = [n for n, size in moved.items() if size == 0.0]
    if still and len(still) < len(moved):
        raise IdentificationError(
            f"{vehicle.where}: {', '.join(still)} never change in the log while the other motors do; is it the log of "
            f"another vehicle? The file has {len(vehicle.rotors)} rotors: check --vehicle, or channel in "
            f"{_tables(vehicle, still)}"
        )


def rotor_notices(problem: Misfit) -> list[Notice]:
    """Return what the fitted windows of a vehicle with rotors cannot tell: motors off, limited or not excited."""
    vehicle, pieces = problem.layout.vehicle, problem.pieces
    out = []
    for piece in pieces:
        off = _off(vehicle, piece)
        share = float(off.mean())
        if share > LIMITS.off_share:
            start, stop, t = float(piece.time[0]), float(piece.time[-1]), piece.time[~off]
            values = {
                "start": start,
                "stop": stop,
                "share": share,
                "first": float(t[0]),
                "last": float(t[-1]),
            }
            out.append(notice("motors-off", f"{start:.1f}:{stop:.1f}", **values))
    return [*out, *_limited(vehicle, pieces), *_unexcited(vehicle, pieces)]


def _limited(vehicle: Vehicle, pieces: Sequence[Piece]) -> Iterator[Notice]:
    """Yield commands at an end of their range, and those that stop again and again at one number inside of it."""
    area = channel_range(vehicle)
    inputs = np.concatenate([p.inputs for p in pieces])
    plateaus = []
    for name, column, low, high in zip(area.names, area.columns, area.idle, area.full, strict=True):
        x = inputs[:, column]
        size = LIMITS.end * (high - low) if np.isfinite(high) else 0.0
        top, bottom = float(np.mean(x >= high - size)), float(np.mean(x <= low + size))
        if max(top, bottom) > LIMITS.limit_share:
            side = "upper" if top > bottom else "lower"
            yield notice("command-saturated", name, end=side, share=max(top, bottom))
        values, counts = np.unique(x, return_counts=True)
        for end, beside, side in ((-1, -2, "above"), (0, 1, "below")):
            at, share = float(values[end]), float(counts[end]) / x.size
            inside = low < at < high and values.size > LIMITS.values
            if inside and share > LIMITS.limit_share and counts[end] > LIMITS.contrast * counts[beside]:
                plateaus.append(notice("command-limited", name, side=side, limit=at, share=share))
    yield from plateaus


def _unexcited(vehicle: Vehicle, pieces: Sequence[Piece]) -> Iterator[Notice]:
    for rate, (axis, moment) in AXES.items():
        column = vehicle.outputs.index(rate)
        spread = max(_largest_rms(p.measured[:, column], p.dt) for p in pieces)
        sigma = getattr(vehicle.file.sensors, rate).sigma
        if spread < LIMITS.motion * sigma:
            yield notice("axis-not-excited", axis, rms=spread, noise=sigma, inertia=f"inertia.{moment}")
    total = [_spins(vehicle, p).sum(axis=0) for p in pieces]
    mean = float(np.mean(np.concatenate(total)))
    change = max(_largest_rms(t, p.dt) for t, p in zip(total, pieces, strict=True))
    if change < LIMITS.lift_change * mean:
        yield notice("lift-not-excited", change=change / mean)


def _largest_rms(x: FloatArray, dt: float) -> float:
    """Return the largest rms about the mean in a burst anywhere: a pulse tells as much in a long window as in a short."""
    known = x[np.isfinite(x)]
    long = max(2, round(LIMITS.burst / dt))
    parts = [known[i : i + long] for i in range(0, max(known.size - long // 2, 1), max(long // 2, 1))]
    return max((float(np.std(part)) for part in (*parts, known) if part.size), default=0.0)


def _spins(vehicle: Vehicle, piece: Piece) -> FloatArray:
    """Return x of every rotor (rotors, n), before lag and delay."""
    rows = np.repeat(parameter_rows(vehicle, piece.changes), len(piece.time), axis=1)
    return np.array([commanded(vehicle, name, rows, piece.inputs.T) for name in vehicle.rotors])


def _off(vehicle: Vehicle, piece: Piece) -> BoolArray:
    """Return where no rotor carries anything (n,)."""
    spins = _spins(vehicle, piece)
    commands = vehicle.file.rotors is not None and vehicle.file.rotors.drive == "command"
    full = 1.0 if commands else float(spins.max())
    return np.asarray(spins.max(axis=0) <= LIMITS.off * max(full, 1e-12))
