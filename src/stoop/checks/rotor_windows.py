"""Whether windows of a flight tell anything of a vehicle with rotors: motors off, saturated, or still; no rates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.variables import RATES
from stoop.errors import FlightError, IdentificationError
from stoop.flight import Flight
from stoop.problem import Misfit, Piece
from stoop.problem.windows import Window
from stoop.simulation import parameter_rows
from stoop.simulation.initial import commanded
from stoop.simulation.rotors import channel_range
from stoop.vehicle import Vehicle

OFF: Final = 0.1  #: of the largest x of all rotors, below which a rotor carries nothing
OFF_SHARE: Final = 0.02  #: of a window with the motors off, that is reported
GROUND_SHARE: Final = 0.5  #: of a window with the motors off, that leaves nothing to fit
END: Final = 1e-6  #: of the range of a channel
LIMIT_SHARE: Final = 0.02  #: of a window at a limit, that is reported
MIN_VALUES: Final = 20  #: different values of a command that is no switch
CONTRAST: Final = 5  #: times as many samples at a plateau as at the value next to it
MIN_LIFT_CHANGE: Final = 0.01  #: of the mean x: the rms of a change that is an input
BURST: Final = 2.0  #: s: about as long as a pulse or a doublet lasts
MIN_MOTION: Final = 3.0  #: times the noise of the file: a rate that moves
AXES: Final = dict(zip(RATES, (("roll", "xx"), ("pitch", "yy"), ("yaw", "zz")), strict=True))


def require_rotors(vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window]) -> None:
    """Refuse a log that lacks some of the motors: most often that of another vehicle.

    Raises
    ------
    FlightError
        Some, but not all, of the rotors' channels are missing.
    """
    for name in dict.fromkeys(w.flight for w in windows):
        there = set(map(str, flights[name].data.data_vars))
        missing = {r: rotor.channel for r, rotor in vehicle.file.rotor.items() if rotor.channel not in there}
        if missing and len(missing) < len(vehicle.rotors):
            raise FlightError(
                f"{name}: no {', '.join(dict.fromkeys(missing.values()))} in this log, but {vehicle.where} has "
                f"{len(vehicle.rotors)} rotors; is it the log of another vehicle? Check --vehicle, or channel in "
                f"{', '.join(f'[rotor.{r}]' for r in missing)}"
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
        if off.mean() > GROUND_SHARE:
            raise IdentificationError(
                f"{windows[piece.maneuver]}: the motors are off in {off.mean():.0%} of it, so it is no flight; choose "
                "--maneuver START:STOP where they carry the vehicle (stoop maneuvers), and check rotors.idle and rotors.gain "
                f"in {vehicle.where}"
            )
    names = sorted({rotor.channel for rotor in vehicle.file.rotor.values()})
    moved = {n: max(float(np.ptp(p.inputs[:, vehicle.inputs.index(n)])) for p in pieces) for n in names}
    still = [n for n, size in moved.items() if size == 0.0]
    if still and len(still) < len(moved):
        rotors = [r for r, rotor in vehicle.file.rotor.items() if rotor.channel in still]
        raise IdentificationError(
            f"{vehicle.where}: {', '.join(still)} never change in the log while the other motors do; is it the log of "
            f"another vehicle? The file has {len(vehicle.rotors)} rotors: check --vehicle, or channel in "
            f"{', '.join(f'[rotor.{r}]' for r in rotors)}"
        )


def rotor_notices(problem: Misfit) -> list[Notice]:
    """Return what the fitted windows of a vehicle with rotors cannot tell."""
    vehicle, pieces = problem.layout.vehicle, problem.pieces
    return [
        *_motors_off(vehicle, pieces),
        *_limited(vehicle, pieces),
        *_unexcited(vehicle, pieces),
    ]


def _motors_off(vehicle: Vehicle, pieces: Sequence[Piece]) -> Iterator[Notice]:
    for piece in pieces:
        off = _off(vehicle, piece)
        if off.mean() > OFF_SHARE:
            start, stop, t = float(piece.time[0]), float(piece.time[-1]), piece.time[~off]
            values = {"start": start, "stop": stop, "share": float(off.mean())}
            yield notice(
                "motors-off", f"{start:.1f}:{stop:.1f}", **values, first=float(t[0]), last=float(t[-1])
            )


def _limited(vehicle: Vehicle, pieces: Sequence[Piece]) -> Iterator[Notice]:
    """Yield commands at an end of their range, and those that stop again and again at one number inside of it."""
    area = channel_range(vehicle)
    inputs = np.concatenate([p.inputs for p in pieces])
    plateaus = []
    for name, column, low, high in zip(area.names, area.columns, area.idle, area.full, strict=True):
        x = inputs[:, column]
        size = END * (high - low) if np.isfinite(high) else 0.0
        top, bottom = float(np.mean(x >= high - size)), float(np.mean(x <= low + size))
        if max(top, bottom) > LIMIT_SHARE:
            side = "upper" if top > bottom else "lower"
            yield notice("command-saturated", name, end=side, share=max(top, bottom))
        values, counts = np.unique(x, return_counts=True)
        for end, beside, side in ((-1, -2, "above"), (0, 1, "below")):
            at, share = float(values[end]), float(counts[end]) / x.size
            inside = low < at < high and values.size > MIN_VALUES
            if inside and share > LIMIT_SHARE and counts[end] > CONTRAST * counts[beside]:
                plateaus.append(notice("command-limited", name, side=side, limit=at, share=share))
    yield from plateaus


def _unexcited(vehicle: Vehicle, pieces: Sequence[Piece]) -> Iterator[Notice]:
    for rate, (axis, moment) in AXES.items():
        column = vehicle.outputs.index(rate)
        spread = max(_largest_rms(p.measured[:, column], p.dt) for p in pieces)
        sigma = getattr(vehicle.file.sensors, rate).sigma
        if spread < MIN_MOTION * sigma:
            yield notice("axis-not-excited", axis, rms=spread, noise=sigma, inertia=f"inertia.{moment}")
    total = [_spins(vehicle, p).sum(axis=0) for p in pieces]
    mean = float(np.mean(np.concatenate(total)))
    change = max(_largest_rms(t, p.dt) for t, p in zip(total, pieces, strict=True))
    if change < MIN_LIFT_CHANGE * mean:
        yield notice("lift-not-excited", change=change / mean)


def _largest_rms(x: FloatArray, dt: float) -> float:
    """Return the largest rms about the mean in `BURST` anywhere: a pulse tells as much in a long window as in a short."""
    known = x[np.isfinite(x)]
    long = max(2, round(BURST / dt))
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
    return np.asarray(spins.max(axis=0) <= OFF * max(full, 1e-12))
