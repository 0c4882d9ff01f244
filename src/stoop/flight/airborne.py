"""Where a vehicle flies: by its speed where wings carry it, by the command of its rotors where they carry it.

Outputs known as pulses only are those of rotors if they turn the vehicle against one another, as motors do and
surfaces do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray, run_slices
from stoop.base.units import STANDARD_GRAVITY
from stoop.base.variables import MOTORS, OUTPUT_PINS, ROTORS, SPECIFIC_FORCE, VELOCITY
from stoop.flight.flight import Flight

EDGE_TIME: Final = 3.0  #: s around take-off and landing that are left alone
MIN_FLYING_SPEED: Final = 2.0  #: m/s; slower is on the ground
FLYING_SHARE: Final = 0.4  #: of the 90 % quantile of the speed; slower is on the ground
MIN_ROTORS: Final = 3  #: motors, at least, of a multirotor
HOVER_SPEED: Final = 3.0  #: m/s over ground, horizontal; no wing carries at that, but in a strong wind
HOVER_HEIGHT: Final = 2.0  #: m above the lowest point of the log
HOVER_TIME: Final = 8.0  #: s in all, for a log to be of a multirotor
LIFT_SHARE: Final = 0.6  #: of the usual lift command in flight; the vehicle falls at less
IDLE_SHARE: Final = 0.25  #: of the largest lift command; motors off, or idling
COMMAND_RANGES: Final = {"pwm": (1000.0, 1000.0), "rotor": (0.0, 1000.0)}  #: idle and range: us, rad/s
MIN_COMMAND: Final = 0.02  #: of the range; less turns nothing
MAX_DROP: Final = 0.5  #: s of too little lift that are no landing

BLOCK: Final = 0.1  #: s over which pulses and rates are averaged; motors respond within that
MIN_BLOCKS: Final = 70  #: for a conclusion from pulses
RUNNING_PULSES: Final = (1050.0, 2500.0)  #: us, in the median; less is idle
MAX_RATE: Final = 100.0  #: rad/s
LEVEL_SPREAD: Final = 0.25  #: of the usual level over idle, by which motors of one vehicle differ
MIN_PULSE_MOTORS: Final = 4  #: on which nothing but pulses is known
SINGULAR_SHARE: Final = 0.04  #: of the strongest direction; weaker ones are drift and whole microseconds
MIN_DIRECTION: Final = 0.03  #: share of what is explained; directions that explain less are left out
MIN_EXPLAINED: Final = (
    0.03  #: share of an angular acceleration that motors explain; gusts and vibration are most of it
)
MIN_WEIGHT: Final = 0.15  #: of the strongest output; less takes no part in turning
MAX_IMBALANCE: Final = 0.15  #: of the sum of sizes: motors that turn a vehicle lift it no more


def flying(flight: Flight) -> BoolArray:
    """Tell at which samples (n,) the vehicle flies, take-off and landing left out; everywhere when nothing tells."""
    return _lifted(flight) if carried_by_rotors(flight) else airborne(flight)


def airborne(flight: Flight) -> BoolArray:
    """Tell where the vehicle flies, by its speed; everywhere when no speed is known."""
    speed = np.full(flight.time.size, np.nan)
    if flight.names >= set(VELOCITY):
        speed = np.sqrt(np.sum([flight.column(name) ** 2 for name in VELOCITY], axis=0))
    else:
        name = next((name for name in ("V", "airspeed_pitot") if name in flight.data), None)
        speed = flight.column(name) if name else speed
    known = np.isfinite(speed)
    if known.sum() < 2:
        return np.ones(speed.size, dtype=bool)
    speed = np.interp(flight.time, flight.time[known], speed[known])
    return _without_edges(
        speed > max(MIN_FLYING_SPEED, FLYING_SHARE * float(np.quantile(speed, 0.9))), flight.rate
    )


def carried_by_rotors(flight: Flight) -> bool:
    """Tell whether rotors carry the vehicle: several motors, or it stood still in the air for a while, or its pulses."""
    several = max(len(_moving(flight, "motor", MOTORS)), len(_moving(flight, "rotor", ROTORS)))
    return several >= MIN_ROTORS or hovered(flight) or bool(rotor_pulses(flight))


def lift_command(flight: Flight) -> FloatArray | None:
    """Return the mean command of the rotors (n,), zero at idle, about one at full; None where none is recorded."""
    throttle = flight.column("control_throttle") if "control_throttle" in flight.data else np.zeros(1)
    if np.nanmax(np.append(np.abs(throttle), 0.0)) > 0.0:
        return throttle
    for kind, size in (("motor", MOTORS), ("rotor", ROTORS), ("pwm", OUTPUT_PINS)):
        names = (rotor_pulses(flight) if kind == "pwm" else []) or _moving(flight, kind, size)
        if len(names) >= MIN_ROTORS:
            idle, full = COMMAND_RANGES.get(kind, (0.0, 1.0))
            return np.asarray(np.mean([(flight.column(name) - idle) / full for name in names], axis=0))
    return None


def motors_ran(flight: Flight) -> bool:
    """Tell whether any rotor was ever commanded to turn, as far as the log says."""
    command = lift_command(flight)
    if command is None:
        return not {"motor_1", "rotor_1"} & flight.names
    return float(np.nanmax(np.append(command, 0.0))) > MIN_COMMAND


def hovered(flight: Flight) -> bool:
    """Tell whether it stood still in the air while its rotors pulled."""
    command = lift_command(flight)
    needed = {"vn", "ve", "altitude", *SPECIFIC_FORCE}
    if command is None or not np.isfinite(command).any() or not flight.names >= needed:
        return False
    height, speed = flight.column("altitude"), np.hypot(flight.column("vn"), flight.column("ve"))
    force = np.sqrt(sum(flight.column(name) ** 2 for name in SPECIFIC_FORCE))
    with np.errstate(invalid="ignore"):
        high = height > np.nanmin(np.append(height, np.inf)) + HOVER_HEIGHT
        pulls = command > max(IDLE_SHARE * float(np.nanquantile(command, 0.99)), MIN_COMMAND)
        weight = np.abs(force - STANDARD_GRAVITY) < 0.3 * STANDARD_GRAVITY
    return bool((high & pulls & weight & (speed < HOVER_SPEED)).sum() > HOVER_TIME * flight.rate)


def rotor_pulses(flight: Flight) -> list[str]:
    """Return the outputs that drive rotors by all that can be seen; none where nothing shows it.

    Four motors or more run at about one level, and turn the vehicle about its roll and its pitch axis by running apart:
    four or more take part in each, and what they add and take away is equal. No set of surfaces does that.
    """
    columns = {
        f"pwm_{n}": flight.column(f"pwm_{n}") for n in range(1, OUTPUT_PINS + 1) if f"pwm_{n}" in flight.data
    }
    finite = {name: x[np.isfinite(x)] for name, x in columns.items()}
    levels = {name: float(np.median(x)) for name, x in finite.items() if x.size and np.ptp(x) > 0.0}
    running = {name: level for name, level in levels.items() if RUNNING_PULSES[0] < level < RUNNING_PULSES[1]}
    usual = float(np.median([*running.values()])) if running else 0.0
    names = [n for n, level in running.items() if abs(level - usual) < LEVEL_SPREAD * (usual - 1000.0)]
    if len(names) < MIN_PULSE_MOTORS or not {"p", "q"} <= flight.names:
        return []
    x = _block_means(flight, names, RUNNING_PULSES[1])
    p, q = _block_means(flight, ["p", "q"], MAX_RATE).T
    return names if _turns(x, p, q) and _turns(x, q, p) else []


def _block_means(flight: Flight, names: Sequence[str], limit: float) -> FloatArray:
    """Return means (b, m) of blocks of samples, clipped to what can be."""
    x = np.column_stack([np.clip(flight.column(name), -limit, limit) for name in names])
    size = max(1, round(BLOCK * flight.rate))
    count = len(x) // size
    return np.asarray(x[: count * size].reshape(count, size, len(names)).mean(axis=1))


def _turns(x: FloatArray, rate: FloatArray, other: FloatArray) -> bool:
    """Tell whether outputs (b, m), running apart, explain how a rate (b,) changes."""
    change = rate[2:] - rate[:-2]
    fixed = np.column_stack([rate[1:-1], other[1:-1], np.ones(len(change))])
    good = np.isfinite(np.column_stack([x[1:-1], fixed, change])).all(axis=1)
    if good.sum() < MIN_BLOCKS:
        return False
    y, outputs = (_residual(a[good], fixed[good]) for a in (change[:, None], x[1:-1]))
    left, sizes, right = np.linalg.svd(outputs, full_matrices=False)
    along = left.T @ y[:, 0]
    kept = (along**2 > MIN_DIRECTION * float(along @ along)) & (sizes > SINGULAR_SHARE * sizes[0])
    along, weights = along[kept], (along[kept] / sizes[kept]) @ right[kept]
    size = np.abs(weights)
    return bool(
        kept.any()
        and along @ along > MIN_EXPLAINED * float(y[:, 0] @ y[:, 0])
        and (size > MIN_WEIGHT * size.max()).sum() >= MIN_PULSE_MOTORS
        and abs(weights.sum()) < MAX_IMBALANCE * size.sum()
    )


def _residual(x: FloatArray, regressors: FloatArray) -> FloatArray:
    """Return columns (b, m) less their regression on others (b, k)."""
    return np.asarray(x - regressors @ np.linalg.lstsq(regressors, x, rcond=None)[0])


def _moving(flight: Flight, kind: str, size: int) -> list[str]:
    """Return the channels of a kind that are not still at zero."""
    names = [f"{kind}_{n}" for n in range(1, size + 1)]
    there = [name for name in names if name in flight.data]
    return [name for name in there if np.nanmax(np.abs(np.append(flight.column(name), 0.0))) > 0.0]


def _lifted(flight: Flight) -> BoolArray:
    """Tell where the rotors' command lifts the vehicle."""
    command = lift_command(flight)
    if command is None or not np.isfinite(command).any():
        return np.ones(flight.time.size, dtype=bool)
    known = np.isfinite(command)
    whole = np.interp(flight.time, flight.time[known], command[known])
    on = whole > IDLE_SHARE * float(np.quantile(whole, 0.99))
    if not on.any():
        return np.zeros(flight.time.size, dtype=bool)
    up = on & (whole > LIFT_SHARE * float(np.median(whole[on])))
    for gap in run_slices(~up):
        if gap.stop - gap.start < MAX_DROP * flight.rate:
            up[gap] = True
    return _without_edges(up, flight.rate)


def _without_edges(up: BoolArray, rate: float) -> BoolArray:
    """Take the time after take-off and before landing away; the ends of the record are neither."""
    edge = round(EDGE_TIME * rate)
    for run in run_slices(up):
        if run.start > 0:
            up[run.start : run.start + edge] = False
        if run.stop < up.size:
            up[max(run.stop - edge, 0) : run.stop] = False
    return up
