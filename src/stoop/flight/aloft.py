"""Where a vehicle flies: by its speed where wings carry it, by what its rotors are told where it can hover."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from stoop.base.arrays import FloatArray
from stoop.base.units import STANDARD_GRAVITY
from stoop.base.variables import MOTORS, OUTPUT_PINS, ROTORS
from stoop.flight.flight import Flight
from stoop.flight.pulses import rotor_pulses
from stoop.flight.segments import runs

BoolArray = npt.NDArray[np.bool_]

TOUCH: Final = 3.0  #: s around take-off and landing that are left alone
CARRIES: Final = 3  #: motors, at least, of what hovers
HOVER_SPEED: Final = 3.0  #: m/s over ground, horizontal; no wing carries at that, but in a strong wind
HOVER_HEIGHT: Final = 2.0  #: m above the lowest point of the log
HOVER_TIME: Final = 8.0  #: s in all, for a log to be of a vehicle that hovers
LIFTS: Final = 0.6  #: of the usual lift command in flight; the vehicle falls at less
OFF: Final = 0.25  #: of the largest lift command; motors off, or idling
IDLES: Final = {"pwm": (1000.0, 1000.0), "rotor": (0.0, 1000.0)}  #: idle and range of a channel: us, rad/s
RAN: Final = 0.02  #: of the range; less turns nothing
DROPPED: Final = 0.5  #: s of too little lift that are no landing


def flying(flight: Flight) -> BoolArray:
    """Tell at which samples (n,) the vehicle flies, take-off and landing left out; everywhere when nothing tells."""
    return _carried(flight) if lifting(flight) else airborne(flight)


def airborne(flight: Flight) -> BoolArray:
    """Tell where the vehicle flies, by its speed; everywhere when no speed is known."""
    speed = _speed(flight)
    known = np.isfinite(speed)
    if known.sum() < 2:
        return np.ones(speed.size, dtype=bool)
    speed = np.interp(flight.time, flight.time[known], speed[known])
    return _without_edges(speed > max(2.0, 0.4 * float(np.quantile(speed, 0.9))), flight.rate)


def lifting(flight: Flight) -> bool:
    """Tell whether rotors carry the vehicle: several motors, or it stood still in the air for a while, or its pulses."""
    several = max(len(_moving(flight, "motor", MOTORS)), len(_moving(flight, "rotor", ROTORS)))
    return several >= CARRIES or hovered(flight) or bool(rotor_pulses(flight))


def lift(flight: Flight) -> FloatArray | None:
    """Return what the rotors are told together (n,), zero at idle, about one at full; None where nothing says."""
    throttle = flight.column("control_throttle") if "control_throttle" in flight.data else np.zeros(1)
    if np.nanmax(np.append(np.abs(throttle), 0.0)) > 0.0:
        return throttle
    for kind, size in (("motor", MOTORS), ("rotor", ROTORS), ("pwm", OUTPUT_PINS)):
        names = (rotor_pulses(flight) if kind == "pwm" else []) or _moving(flight, kind, size)
        if len(names) >= CARRIES:
            idle, full = IDLES.get(kind, (0.0, 1.0))
            return np.asarray(np.mean([(flight.column(name) - idle) / full for name in names], axis=0))
    return None


def motors_ran(flight: Flight) -> bool:
    """Tell whether any rotor was ever told to turn, as far as the log says."""
    told = lift(flight)
    if told is None:
        return not {"motor_1", "rotor_1"} & {str(name) for name in flight.data.data_vars}
    return float(np.nanmax(np.append(told, 0.0))) > RAN


def _moving(flight: Flight, kind: str, size: int) -> list[str]:
    """Return the channels of a kind that are not still at zero."""
    names = [f"{kind}_{n}" for n in range(1, size + 1)]
    there = [name for name in names if name in flight.data]
    return [name for name in there if np.nanmax(np.abs(np.append(flight.column(name), 0.0))) > 0.0]


def hovered(flight: Flight) -> bool:
    """Tell whether it stood still in the air while its rotors pulled."""
    there, told = {str(name) for name in flight.data.data_vars}, lift(flight)
    if told is None or not np.isfinite(told).any() or not {"vn", "ve", "altitude", "ax", "ay", "az"} <= there:
        return False
    height, speed = flight.column("altitude"), np.hypot(flight.column("vn"), flight.column("ve"))
    force = np.sqrt(sum(flight.column(name) ** 2 for name in ("ax", "ay", "az")))
    with np.errstate(invalid="ignore"):
        aloft = height > np.nanmin(np.append(height, np.inf)) + HOVER_HEIGHT
        pulls = told > max(OFF * float(np.nanquantile(told, 0.99)), RAN)
        weight = np.abs(force - STANDARD_GRAVITY) < 0.3 * STANDARD_GRAVITY
    return bool((aloft & pulls & weight & (speed < HOVER_SPEED)).sum() > HOVER_TIME * flight.rate)


def _carried(flight: Flight) -> BoolArray:
    told = lift(flight)
    if told is None or not np.isfinite(told).any():
        return np.ones(flight.time.size, dtype=bool)
    seen = np.isfinite(told)
    whole = np.interp(flight.time, flight.time[seen], told[seen])
    on = whole > OFF * float(np.quantile(whole, 0.99))
    if not on.any():
        return np.zeros(flight.time.size, dtype=bool)
    up = on & (whole > LIFTS * float(np.median(whole[on])))
    for gap in runs(~up):
        if gap.stop - gap.start < DROPPED * flight.rate:
            up[gap] = True
    return _without_edges(up, flight.rate)


def _without_edges(up: BoolArray, rate: float) -> BoolArray:
    """Take the time after take-off and before landing away; the ends of the record are neither."""
    edge = round(TOUCH * rate)
    for run in runs(up):
        if run.start > 0:
            up[run.start : run.start + edge] = False
        if run.stop < up.size:
            up[max(run.stop - edge, 0) : run.stop] = False
    return up


def _speed(flight: Flight) -> FloatArray:
    if {"vn", "ve", "vd"} <= set(flight.data):
        return np.asarray(np.sqrt(np.sum([flight.column(name) ** 2 for name in ("vn", "ve", "vd")], axis=0)))
    name = next((name for name in ("V", "airspeed_pitot") if name in flight.data), None)
    return flight.column(name) if name else np.full(flight.time.size, np.nan)
