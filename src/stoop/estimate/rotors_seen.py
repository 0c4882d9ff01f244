"""Whether a log tells anything of a vehicle with rotors: motors off, saturated, still or of another vehicle; no rates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.base.units import DEGREE
from stoop.errors import FlightError, IdentificationError
from stoop.flight import Flight
from stoop.problem import Misfit, Piece
from stoop.problem.windows import Window, within
from stoop.simulate import parameter_rows
from stoop.simulate.initial import commanded
from stoop.simulate.rotors import channel_range
from stoop.vehicle import Vehicle

OFF: Final = 0.1  #: of the largest x of all rotors, below which a rotor carries nothing
RESTING: Final = 0.02  #: share of a window with the motors off that is worth a word
GROUNDED: Final = 0.5  #: and that leaves nothing to fit
END: Final = 1e-6  #: of the range of a channel
CLIPPED: Final = 0.02  #: share of a window at an end of the range that is worth a word
ALIVE: Final = 20  #: different values of a command that is no switch
CONTRAST: Final = 5  #: times as many samples at a plateau as at the value next to it
STILL: Final = 0.01  #: of the mean x: the rms of a change that is no input
BURST: Final = 2.0  #: s: about as long as a pulse or a doublet lasts
SPINS: Final = ("motor", "rotor")  #: channels that turn a rotor and nothing else
LIKENESS: Final = (
    3.0  #: times the rotors' scatter, by which an output may lie beside them, and scatter more or less
)
LOUD: Final = 3.0  #: times the noise of the file: a rate that moves
RATES: Final = ("p", "q", "r")
_AXES: Final = dict(zip(RATES, (("roll", "xx"), ("pitch", "yy"), ("yaw", "zz")), strict=True))


def check_motors(vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window]) -> None:
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


def check_rotors(vehicle: Vehicle, windows: Sequence[Window], pieces: Sequence[Piece]) -> None:
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
        if off.mean() > GROUNDED:
            raise IdentificationError(
                f"{windows[piece.maneuver]}: the motors are off in {off.mean():.0%} of it, so it is no flight; choose "
                "--maneuver START:STOP where they carry the vehicle (stoop maneuvers), and check rotors.idle and rotors.gain "
                f"in {vehicle.where}"
            )
    _check_channels(vehicle, pieces)


def _check_channels(vehicle: Vehicle, pieces: Sequence[Piece]) -> None:
    """Refuse rotors whose channels stand still while others move: the log of another vehicle."""
    names = {rotor.channel for rotor in vehicle.file.rotor.values()}
    moved = {
        n: max(float(np.ptp(p.inputs[:, vehicle.inputs.index(n)])) for p in pieces) for n in sorted(names)
    }
    still = [n for n, size in moved.items() if size == 0.0]
    if still and len(still) < len(moved):
        rotors = [r for r, rotor in vehicle.file.rotor.items() if rotor.channel in still]
        raise IdentificationError(
            f"{vehicle.where}: {', '.join(still)} never change in the log while the other motors do; is it the log of "
            f"another vehicle? The file has {len(vehicle.rotors)} rotors: check --vehicle, or channel in "
            f"{', '.join(f'[rotor.{r}]' for r in rotors)}"
        )


def _spins(vehicle: Vehicle, piece: Piece) -> FloatArray:
    """Return x of every rotor (rotors, n), before lag and delay."""
    rows = np.repeat(parameter_rows(vehicle, piece.changes), len(piece.time), axis=1)
    return np.array([commanded(vehicle, name, rows, piece.inputs.T) for name in vehicle.rotors])


def _off(vehicle: Vehicle, piece: Piece) -> NDArray[np.bool_]:
    """Return where no rotor carries anything (n,)."""
    spins = _spins(vehicle, piece)
    full = (
        1.0
        if vehicle.file.rotors is not None and vehicle.file.rotors.drive == "command"
        else float(spins.max())
    )
    return np.asarray(spins.max(axis=0) <= OFF * max(full, 1e-12))


def rotor_warnings(problem: Misfit) -> list[str]:
    """Return in words what the fitted windows of a vehicle with rotors cannot tell."""
    vehicle, pieces = problem.layout.vehicle, problem.pieces
    return [
        *_resting(vehicle, pieces),
        *_clipped(vehicle, pieces),
        *_plateaus(vehicle, pieces),
        *_unexcited(vehicle, pieces),
    ]


def _resting(vehicle: Vehicle, pieces: Sequence[Piece]) -> Iterator[str]:
    for piece in pieces:
        off = _off(vehicle, piece)
        if off.mean() > RESTING:
            t = piece.time[~off]
            yield (
                f"The motors are off in {off.mean():.0%} of {piece.time[0]:.1f}:{piece.time[-1]:.1f}, and on the ground the "
                f"equations do not hold: narrow --maneuver to within {t[0]:.1f}:{t[-1]:.1f}."
            )


def _clipped(vehicle: Vehicle, pieces: Sequence[Piece]) -> Iterator[str]:
    area = channel_range(vehicle)
    inputs = np.concatenate([p.inputs for p in pieces])
    for name, column, low, high in zip(area.names, area.columns, area.idle, area.full, strict=True):
        size = END * (high - low) if np.isfinite(high) else 0.0
        share = float(np.mean(inputs[:, column] >= high - size)) if np.isfinite(high) else 0.0
        bottom = float(np.mean(inputs[:, column] <= low + size))
        if max(share, bottom) > CLIPPED:
            end = "upper" if share > bottom else "lower"
            yield (
                f"{name} is at the {end} end of its range in {max(share, bottom):.0%} of the fitted windows: what the motor "
                "did there is not what was commanded; fit windows without saturation, or gentler maneuvers."
            )


def _plateaus(vehicle: Vehicle, pieces: Sequence[Piece]) -> Iterator[str]:
    """Tell which commands stop again and again at one number inside their range: something between limits them."""
    area = channel_range(vehicle)
    for name, column, low, high in zip(area.names, area.columns, area.idle, area.full, strict=True):
        x = np.concatenate([p.inputs[:, column] for p in pieces])
        values, counts = np.unique(x, return_counts=True)
        for end, beside, word in ((-1, -2, "above"), (0, 1, "below")):
            at, share = float(values[end]), float(counts[end]) / x.size
            inside = low < at < high and values.size > ALIVE
            if inside and share > CLIPPED and counts[end] > CONTRAST * counts[beside]:
                yield (
                    f"{name} never goes {word} {at:.3g}, where it is in {share:.0%} of the fitted windows: it was limited there, "
                    "or its column is clipped; fit windows in which it moves freely, or look at the column that the mapping "
                    f"names for {name} and at the limits of the autopilot."
                )


def _unexcited(vehicle: Vehicle, pieces: Sequence[Piece]) -> Iterator[str]:
    for rate, (axis, moment) in _AXES.items():
        column = vehicle.outputs.index(rate)
        spread = max(_liveliest(p.measured[:, column], p.dt) for p in pieces)
        sigma = getattr(vehicle.file.sensors, rate).sigma
        if spread < LOUD * sigma:
            yield (
                f"There is no {axis} to speak of ({spread / DEGREE:.2g} deg/s rms at the liveliest, noise {sigma / DEGREE:.2g}): "
                f"inertia.{moment}, lag, and what {axis} moments rest on cannot be told; fit a window with {axis} doublets."
            )
    total = [_spins(vehicle, p).sum(axis=0) for p in pieces]
    mean = float(np.mean(np.concatenate(total)))
    change = max(_liveliest(t, p.dt) for t, p in zip(total, pieces, strict=True))
    if change < STILL * mean:
        yield (
            f"The sum of all motors hardly changes ({change / mean:.1%} rms at the liveliest): T0, T1 and T2 cannot be told "
            "apart, nor inflow from them; fit a window with climbs, descents and steps of thrust, or --fix two of the three."
        )


def _liveliest(x: FloatArray, dt: float) -> float:
    """Return the largest rms (n,) about the mean in `BURST` anywhere: a pulse tells as much in a long window as in a short."""
    seen = x[np.isfinite(x)]
    long = max(2, round(BURST / dt))
    parts = [seen[i : i + long] for i in range(0, max(seen.size - long // 2, 1), max(long // 2, 1))]
    return max((float(np.std(part)) for part in (*parts, seen) if part.size), default=0.0)


def strange_motors(vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window]) -> list[str]:
    """Tell which motors of the log move though no rotor of a vehicle that hovers has them."""
    if not vehicle.rotors:
        return []
    out = []
    for name in dict.fromkeys(w.flight for w in windows):
        own = [w for w in windows if w.flight == name]
        others = list(_others(vehicle, flights[name], own))
        if others:
            out.append(
                f"{name}: {', '.join(others)} move too, but no rotor of {vehicle.where} has them: check --vehicle, or "
                "add a [rotor.NAME] table for each."
            )
    return out


def _others(vehicle: Vehicle, flight: Flight, windows: Sequence[Window]) -> Iterator[str]:
    """Return channels of the rotors' kind that no rotor has: motors that move, and outputs that move as the rotors' do."""
    known = {rotor.channel for rotor in vehicle.file.rotor.values()}
    there = [str(c) for c in flight.data.data_vars]
    usual = [_level(flight, c, windows) for c in known if c in there]
    for channel in there:
        if channel in known or channel in vehicle.recorded or _kind(channel) not in map(_kind, known):
            continue
        middle, spread = _level(flight, channel, windows)
        if spread > 0.0 and (_kind(channel) in SPINS or _is_alike(middle, spread, usual)):
            yield channel


def _kind(channel: str) -> str:
    return channel.rpartition("_")[0]


def _is_alike(middle: float, spread: float, usual: Sequence[tuple[float, float]]) -> bool:
    """Tell whether an output, which may move a surface as well, is where rotors are, and moves as much."""
    middles, spreads = np.array(usual).T
    near = LIKENESS * float(np.median(spreads))
    inside = middles.min() - near <= middle <= middles.max() + near
    return bool(inside and 1.0 / LIKENESS < spread / max(float(np.median(spreads)), 1e-12) < LIKENESS)


def _level(flight: Flight, channel: str, windows: Sequence[Window]) -> tuple[float, float]:
    """Return the median of a channel in windows, and how far it scatters; zeros where it was not recorded."""
    seen = flight.column(channel)[within(flight, windows)]
    seen = seen[np.isfinite(seen)]
    if not seen.size or np.ptp(seen) == 0.0:  # rounding gives what is constant a scatter
        return (float(seen[0]) if seen.size else 0.0), 0.0
    return float(np.median(seen)), float(np.std(seen))
