"""Where a vehicle flies: by its speed where wings carry it, by the command of its rotors where they carry it.

Outputs known as pulses only are those of rotors if they turn the vehicle against one another, as motors do and
surfaces do not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray, run_slices
from stoop.base.autopilots import ARDUPILOT
from stoop.base.units import STANDARD_GRAVITY
from stoop.base.variables import FAMILIES, SPECIFIC_FORCE, VELOCITY
from stoop.errors import FlightError

if TYPE_CHECKING:
    from stoop.flight.flight import Flight


@dataclass(frozen=True)
class FlyingLimits:
    """When a vehicle flies, and when rotors carry it."""

    edge: float = 3.0  #: s around take-off and landing that are left alone
    speed: float = 2.0  #: m/s; slower is on the ground
    speed_share: float = 0.4  #: of the 90 % quantile of the speed; slower is on the ground
    rotors: int = 3  #: motors, at least, of what they carry
    hover_speed: float = 3.0  #: m/s over ground, horizontal; no wing carries at that, but in a strong wind
    hover_height: float = 2.0  #: m above the lowest point of the log
    hover_time: float = 8.0  #: s in all, for a log to be of a vehicle that rotors carry
    lift: float = 0.6  #: of the usual lift command in flight; the vehicle falls at less
    idle: float = 0.25  #: of the largest lift command; motors off, or idling
    command: float = 0.02  #: of the range; less turns nothing
    drop: float = 0.5  #: s of too little lift that are no landing
    least: float = 3.0  #: s, of a flight


@dataclass(frozen=True)
class PulseLimits:
    """When pulses are those of motors."""

    block: float = 0.1  #: s over which pulses and rates are averaged; motors respond within that
    blocks: int = 70  #: for a conclusion
    running: tuple[float, float] = (1050.0, 2500.0)  #: us, in the median; less is idle
    rate: float = 100.0  #: rad/s, the largest
    spread: float = 0.25  #: of the usual level over idle, by which motors of one vehicle differ
    motors: int = 4  #: at least, on which nothing but pulses is known
    singular: float = 0.04  #: of the strongest direction; weaker ones are drift and whole microseconds
    direction: float = 0.03  #: share of what is explained; directions that explain less are left out
    explained: float = 0.03  #: share of an angular acceleration; gusts and vibration are most of it
    weight: float = 0.15  #: of the strongest output; less takes no part in turning
    imbalance: float = 0.15  #: of the sum of sizes: motors that turn a vehicle lift it no more


FLYING: Final = FlyingLimits()
PULSES: Final = PulseLimits()
ROTOR_KINDS: Final = (
    ("motor", 0.0, 1.0),
    ("rotor", 0.0, 1000.0),
    ("pwm", 1000.0, 1000.0),
)  #: family of variables, idle and range: 1, rad/s, us


def flying(flight: Flight) -> BoolArray:
    """Tell at which samples (n,) the vehicle flies, take-off and landing left out; everywhere when nothing tells."""
    if not flight.carried_by_rotors():
        return flight.airborne()
    command = flight.lift_command()
    if command is None or not np.isfinite(command).any():
        return np.ones(flight.time.size, dtype=bool)
    known = np.isfinite(command)
    whole = np.interp(flight.time, flight.time[known], command[known])
    on = whole > FLYING.idle * float(np.quantile(whole, 0.99))
    if not on.any():
        return np.zeros(flight.time.size, dtype=bool)
    up = on & (whole > FLYING.lift * float(np.median(whole[on])))
    for gap in run_slices(~up):
        if gap.stop - gap.start < FLYING.drop * flight.rate:
            up[gap] = True
    return _without_edges(up, flight.rate)


def in_flight(flight: Flight) -> BoolArray:
    """Tell which samples (n,) tell of the vehicle in flight; all of a log that shows no flight.

    The horizontal speed tells as well: the vertical one may be in a wrong unit.
    """
    up = flight.flying()
    if not flight.carried_by_rotors() and flight.names >= set(VELOCITY):
        up |= _without_edges(carried_by_speed(flight, VELOCITY[:2]), flight.rate)
    return up if up.sum() >= FLYING.least * flight.rate else np.ones(up.size, dtype=bool)


def airborne(flight: Flight) -> BoolArray:
    """Tell where the vehicle flies, by its speed, take-off and landing left out; everywhere when no speed is known."""
    return _without_edges(carried_by_speed(flight), flight.rate)


def carried_by_speed(flight: Flight, velocity: tuple[str, ...] = VELOCITY) -> BoolArray:
    """Tell where the speed, by components of the velocity, is one of flight; everywhere when no speed is known."""
    speed = np.full(flight.time.size, np.nan)
    if flight.names >= set(velocity):
        speed = np.sqrt(np.sum([flight.column(name) ** 2 for name in velocity], axis=0))
    else:
        name = next((name for name in ("V", "airspeed_pitot") if name in flight.names), None)
        speed = flight.column(name) if name else speed
    known = np.isfinite(speed)
    if known.sum() < 2:
        return np.ones(speed.size, dtype=bool)
    speed = np.interp(flight.time, flight.time[known], speed[known])
    least = max(FLYING.speed, FLYING.speed_share * float(np.quantile(speed, 0.9)))
    return np.asarray(speed > least)


def _without_edges(up: BoolArray, rate: float) -> BoolArray:
    """Take the time after take-off and before landing away; the ends of the record are neither."""
    edge = round(FLYING.edge * rate)
    for run in run_slices(up):
        if run.start > 0:
            up[run.start : run.start + edge] = False
        if run.stop < up.size:
            up[max(run.stop - edge, 0) : run.stop] = False
    return up


def carried_by_rotors(flight: Flight) -> bool:
    """Tell whether rotors carry the vehicle: several motors, or it stood still in the air for a while, or its pulses."""
    several = max(len(_moving(flight, kind)) for kind in ("motor", "rotor"))
    return several >= FLYING.rotors or hovered(flight) or bool(flight.rotor_pulses())


def lift_command(flight: Flight) -> FloatArray | None:
    """Return the mean command of the rotors (n,), zero at idle, about one at full; None where none is recorded."""
    throttle = flight.column("control_throttle") if "control_throttle" in flight.names else np.zeros(1)
    if np.nanmax(np.append(np.abs(throttle), 0.0)) > 0.0:
        return throttle
    for kind, idle, full in ROTOR_KINDS:
        names = (flight.rotor_pulses() if kind == "pwm" else []) or _moving(flight, kind)
        if len(names) >= FLYING.rotors:
            return np.asarray(np.mean([(flight.column(name) - idle) / full for name in names], axis=0))
    return None


def _moving(flight: Flight, kind: str) -> list[str]:
    """Return the channels of a kind that are not still at zero; of pulses those that ArduPilot's parameters allow a motor."""
    there = [name for name in FAMILIES[kind] if name in flight.names]
    if kind == "pwm":  # 0: none said
        functions = ((n, flight.parameters.get(f"SERVO{n[4:]}_FUNCTION", 0.0)) for n in there)
        there = [name for name, use in functions if use == 0.0 or use in ARDUPILOT.motors]
    return [name for name in there if np.nanmax(np.abs(np.append(flight.column(name), 0.0))) > 0.0]


def motors_ran(flight: Flight) -> bool:
    """Tell whether any rotor that carries the vehicle was ever commanded to turn, as far as the log says.

    Fewer motors than carry a vehicle are those of an aeroplane, which flies, or glides, by its wings.
    """
    command = flight.lift_command()
    if command is None:
        every = [[n for n in FAMILIES[kind] if n in flight.names] for kind in ("motor", "rotor")]
        known = [[n for n in own if np.isfinite(flight.column(n)).any()] for own in every]
        still = all(not _moving(flight, kind) for kind in ("motor", "rotor"))
        return not still or max(map(len, known)) < FLYING.rotors
    return float(np.nanmax(np.append(command, 0.0))) > FLYING.command


def require_motors_ran(flight: Flight) -> None:
    """Refuse a flight in which nothing flew: FlightError."""
    if not motors_ran(flight):
        command = flight.lift_command()
        most = 0.0 if command is None else float(np.nanmax(np.append(command, 0.0)))
        raise FlightError(
            f"{flight.name}: the motors never ran (their commands reach {100.0 * most:.0f} % at most): nothing flew in this "
            "log; give a log of a flight, or check the scale of the motor channels in the mapping"
        )


def hovered(flight: Flight) -> bool:
    """Tell whether it stood still in the air while its rotors pulled."""
    needed = {"vn", "ve", "altitude", *SPECIFIC_FORCE}
    command = flight.lift_command() if flight.names >= needed else None
    if command is None or not np.isfinite(command).any():
        return False
    height, speed = flight.column("altitude"), np.hypot(flight.column("vn"), flight.column("ve"))
    force = np.sqrt(sum(flight.column(name) ** 2 for name in SPECIFIC_FORCE))
    with np.errstate(invalid="ignore"):
        high = height > np.nanmin(np.append(height, np.inf)) + FLYING.hover_height
        pulls = command > max(FLYING.idle * float(np.nanquantile(command, 0.99)), FLYING.command)
        weight = np.abs(force - STANDARD_GRAVITY) < 0.3 * STANDARD_GRAVITY
    still = high & pulls & weight & (speed < FLYING.hover_speed)
    return bool(still.sum() > FLYING.hover_time * flight.rate)


def rotor_pulses(flight: Flight) -> list[str]:
    """Return the outputs that drive rotors by all that can be seen; none where nothing shows it.

    Four motors or more run at about one level, and turn the vehicle about its roll and its pitch axis by running apart:
    four or more take part in each, and what they add and take away is equal. No set of surfaces does that.
    """
    running: dict[str, float] = {}
    for name in FAMILIES["pwm"]:
        x = flight.column(name) if name in flight.names else np.empty(0)
        x = x[np.isfinite(x)]
        if x.size and np.ptp(x) > 0.0 and PULSES.running[0] < float(np.median(x)) < PULSES.running[1]:
            running[name] = float(np.median(x))
    usual = float(np.median([*running.values()])) if running else 0.0
    names = [n for n, level in running.items() if abs(level - usual) < PULSES.spread * (usual - 1000.0)]
    if len(names) < PULSES.motors or not {"p", "q"} <= flight.names:
        return []
    limits = [PULSES.running[1]] * len(names) + [PULSES.rate] * 2
    columns = [np.clip(flight.column(n), -x, x) for n, x in zip((*names, "p", "q"), limits, strict=True)]
    size = max(1, round(PULSES.block * flight.rate))
    count = flight.time.size // size
    blocks = np.column_stack(columns)[: count * size].reshape(count, size, len(columns)).mean(axis=1)
    x, p, q = blocks[:, :-2], blocks[:, -2], blocks[:, -1]
    return names if _turns(x, p, q) and _turns(x, q, p) else []


def _turns(x: FloatArray, rate: FloatArray, other: FloatArray) -> bool:
    """Tell whether outputs (b, m), running apart, explain how a rate (b,) changes."""
    change = rate[2:] - rate[:-2]
    fixed = np.column_stack([rate[1:-1], other[1:-1], np.ones(len(change))])
    good = np.isfinite(np.column_stack([x[1:-1], fixed, change])).all(axis=1)
    if good.sum() < PULSES.blocks:
        return False
    fixed, known = fixed[good], (change[good, None], x[1:-1][good])
    y, outputs = (a - fixed @ np.linalg.lstsq(fixed, a, rcond=None)[0] for a in known)
    left, sizes, right = np.linalg.svd(outputs, full_matrices=False)
    along = left.T @ y[:, 0]
    kept = (along**2 > PULSES.direction * float(along @ along)) & (sizes > PULSES.singular * sizes[0])
    along, weights = along[kept], (along[kept] / sizes[kept]) @ right[kept]
    size = np.abs(weights)
    return bool(
        kept.any()
        and along @ along > PULSES.explained * float(y[:, 0] @ y[:, 0])
        and (size > PULSES.weight * size.max()).sum() >= PULSES.motors
        and abs(weights.sum()) < PULSES.imbalance * size.sum()
    )
