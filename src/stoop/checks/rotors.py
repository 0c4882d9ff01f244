"""Checks that flights show the rotors of a vehicle file and that their windows determine something of it, by kind of vehicle."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.variables import RATES
from stoop.errors import IdentificationError
from stoop.flight import Flight
from stoop.flight.airborne import carried_by_speed
from stoop.problem import Misfit, Piece
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle
from stoop.vehicle.channels import AIR_FRAME, GROUND_FRAME

#: value at full power of channels, by name or kind; N and rad/s: enough to be no noise
POWER: Final = {"motor": 1.0, "rotor": 300.0, "control_throttle": 1.0, "throttle": 1.0, "thrust": 10.0}
AXES: Final = dict(zip(RATES, (("roll", "xx"), ("pitch", "yy"), ("yaw", "zz")), strict=True))


class Limits:
    """What makes windows of rotor flight useless or doubtful, and flights those of another vehicle."""

    lift: Final = 0.25  #: of the usual lift commands of two flights, over their mean, by which they differ
    #: times the rotors' scatter, by which an output may lie beside them, and scatter more or less, to be taken for a rotor's
    likeness: Final = 3.0
    off: Final = 0.1  #: of the largest x of all rotors, below which a rotor carries nothing
    off_share: Final = 0.02  #: of a window with the motors off, that is reported
    ground_share: Final = 0.5  #: of a window with the motors off, that leaves nothing to fit
    end: Final = 1e-6  #: of the range of a channel
    limit_share: Final = 0.02  #: of a window at a limit, that is reported
    values: Final = 20  #: different values of a command that is no switch
    contrast: Final = 5  #: times as many samples at a plateau as at the value next to it
    lift_change: Final = 0.01  #: of the mean x: the rms of a change that is an input
    burst: Final = 2.0  #: s: about as long as a pulse or a doublet lasts
    running: Final = 0.1  #: of full command or speed, above which a motor gives thrust
    motion: Final = 3.0  #: times the noise of the file: a rate that moves


def foreign_motors(vehicle: Vehicle, flight: Flight, windows: Sequence[Window]) -> list[Notice]:
    """Return which motors of a log move though no rotor of the vehicle has them.

    An output, which may move a surface as well, is one where it lies where the rotors' are, and moves as much.
    """
    inside = Window.within(flight, windows)

    def level(channel: str) -> tuple[float, float]:
        """Return the median of a channel, and how far it scatters; zeros where it was not recorded."""
        x = flight.column(channel)[inside]
        known = x[np.isfinite(x)]
        if not known.size or np.ptp(known) == 0.0:  # rounding gives what is constant a scatter
            return (float(known[0]) if known.size else 0.0), 0.0
        return float(np.median(known)), float(np.std(known))

    own = {rotor.channel for rotor in vehicle.file.rotor.values()}
    there = list(flight.channels)
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
            near = Limits.likeness * scatter
            inner = middles.min() - near <= middle <= middles.max() + near
            alike = inner and 1.0 / Limits.likeness < spread / max(scatter, 1e-12) < Limits.likeness
            spread = spread if alike else 0.0
        if spread > 0.0:
            channels.append(channel)
    found = notice("foreign-motors", flight.name, channels=tuple(channels), vehicle=vehicle.where)
    return [found] if channels else []


def thrust_missing(vehicle: Vehicle, flight: Flight, windows: Sequence[Window]) -> list[Notice]:
    """Return which motors run though the file of an aircraft has no propulsion: drag takes up their thrust."""
    if vehicle.file.propulsion is not None:
        return []
    inside, running = Window.within(flight, windows), []
    for channel in (str(name) for name in flight.channels):
        full = POWER.get(channel.rpartition("_")[0] if channel[-1].isdigit() else channel)
        if full is not None and channel not in vehicle.recorded:
            x = flight.column(channel)[inside]
            known = x[np.isfinite(x)]
            running += [channel] if known.size and np.max(known) > Limits.running * full else []
    if not running:
        return []
    count, where = len(running), vehicle.where
    return [notice("thrust-missing", flight.name, channels=tuple(running), count=count, vehicle=where)]


def _tables(vehicle: Vehicle, channels: Sequence[str]) -> str:
    """Name the tables of the rotors that these channels drive."""
    rotors = vehicle.file.rotor.items()
    return ", ".join(f"[rotor.{name}]" for name, rotor in rotors if rotor.channel in channels)


def _other_aircraft(vehicle: Vehicle, missing: Sequence[str], on_rotors: bool) -> str:
    advice = f"the vehicle of this log is carried by rotors, but {vehicle.where} has none: is it another? "
    return advice if on_rotors else ""


def _other_rotors(vehicle: Vehicle, missing: Sequence[str], on_rotors: bool) -> str:
    if not on_rotors:
        return f"{vehicle.where} flies on rotors, but this log has no rotors: does it belong to another vehicle? "
    rotors = _tables(vehicle, missing)
    tables = f", or channel in {rotors}" if rotors else ""
    known = f"{vehicle.where} has {len(vehicle.rotors)} rotors"
    return f"{known}: does the log belong to another vehicle{tables}? "


def _lift_of_aircraft(vehicle: Vehicle, carried: Mapping[str, Flight]) -> list[Notice]:
    return [notice("flight-on-rotors", name, vehicle=vehicle.where) for name in carried]


def _lift_differs(vehicle: Vehicle, carried: Mapping[str, Flight]) -> list[Notice]:
    """Compare the commands that usually carry the vehicle in its flights."""
    levels = {}
    for name, flight in carried.items():
        command = flight.lift_command()
        known = np.empty(0) if command is None else command[flight.flying() & np.isfinite(command)]
        if known.size and (level := float(np.median(known))) > 0.0:
            levels[name] = level
    low, high = (pick(levels, key=lambda n: levels[n], default="") for pick in (min, max))
    if not levels or levels[high] - levels[low] <= Limits.lift * 0.5 * (levels[high] + levels[low]):
        return []
    return [notice("lift-differs", low, level=levels[low], other=high, other_level=levels[high])]


def _require_flight(vehicle: Vehicle, windows: Sequence[Window], pieces: Sequence[Piece]) -> None:
    """Refuse windows without rates or with the motors off, and channels that are no rotor's: IdentificationError."""
    columns = [vehicle.outputs.index(c) for c in RATES]
    for piece in pieces:
        if not np.isfinite(piece.whole[:, columns]).any():
            raise IdentificationError(
                f"{windows[piece.maneuver]}: none of the rates p, q, r was recorded, and without them nothing determines moments "
                "or lag; log the gyroscope, or name its columns in the mapping file ([variables] p = ..., see stoop map)"
            )
        off = _off(vehicle, piece)
        if off.mean() > Limits.ground_share:
            raise IdentificationError(
                f"{windows[piece.maneuver]}: the motors are off in {off.mean():.0%} of it, so it is no flight; choose "
                "--maneuver START:STOP where they carry the vehicle (stoop maneuvers), and check rotors.idle and rotors.gain "
                f"in {vehicle.where}"
            )
    area = vehicle.rotor_range
    moved = np.max([np.ptp(p.inputs[:, area.columns], axis=0) for p in pieces], axis=0)
    still = [name for name, size in sorted(zip(area.names, moved, strict=True)) if size == 0.0]
    if still and len(still) < len(area.names):
        raise IdentificationError(
            f"{vehicle.where}: {', '.join(still)} never change in the log while the other motors do; is it the log of "
            f"another vehicle? The file has {len(vehicle.rotors)} rotors: check --vehicle, or channel in "
            f"{_tables(vehicle, still)}"
        )


def windows_on_ground(_: Vehicle, flight: Flight, windows: Sequence[Window]) -> list[Notice]:
    """Return the windows in part of which an aircraft does not fly, by its speed, and what is left of each."""
    out, up = [], carried_by_speed(flight)
    for window in windows:
        inside = flight.between(window.start, window.stop) if window.flight == flight.name else slice(0)
        share = float(np.mean(~up[inside])) if up[inside].size else 0.0
        if share > Limits.off_share:
            t = flight.time[inside][up[inside]]
            first, last = (float(t[0]), float(t[-1])) if t.size else (np.nan, np.nan)
            code = "window-partly-on-ground" if t.size else "window-on-ground"
            out.append(notice(code, str(window), share=share, first=first, last=last))
    return out


@dataclass(frozen=True)
class KindChecks:
    """What flights and windows of a kind of vehicle are checked for."""

    #: vehicle, channels that a flight lacks, whether rotors carry it -> what speaks for another vehicle
    other_vehicle: Callable[[Vehicle, Sequence[str], bool], str]
    lift: Callable[[Vehicle, Mapping[str, Flight]], list[Notice]]  #: of flights that rotors carry
    motors: tuple[Callable[[Vehicle, Flight, Sequence[Window]], list[Notice]], ...] = ()
    windows: tuple[Callable[[Vehicle, Flight, Sequence[Window]], list[Notice]], ...] = ()  #: that were chosen
    data: tuple[Callable[[Vehicle, Sequence[Window], Sequence[Piece]], None], ...] = ()  #: refuse windows


KINDS: Final = {
    AIR_FRAME: KindChecks(
        _other_aircraft, _lift_of_aircraft, motors=(thrust_missing,), windows=(windows_on_ground,)
    ),
    GROUND_FRAME: KindChecks(_other_rotors, _lift_differs, motors=(foreign_motors,), data=(_require_flight,)),
}


def rotor_notices(problem: Misfit) -> list[Notice]:
    """Return what the fitted windows of a vehicle with rotors cannot tell: motors off, limited or not excited."""
    vehicle, pieces = problem.layout.vehicle, problem.pieces
    out = []
    for piece in pieces:
        off = _off(vehicle, piece)
        share = float(off.mean())
        if share > Limits.off_share:
            start, stop, t = float(piece.time[0]), float(piece.time[-1]), piece.time[~off]
            span = {"start": start, "stop": stop, "first": float(t[0]), "last": float(t[-1])}
            out.append(notice("motors-off", f"{start:.1f}:{stop:.1f}", share=share, **span))
    return [*out, *_limited(vehicle, pieces), *_unexcited(vehicle, pieces)]


def _limited(vehicle: Vehicle, pieces: Sequence[Piece]) -> Iterator[Notice]:
    """Yield commands at an end of their range, and those that stop again and again at one number inside of it."""
    area = vehicle.rotor_range
    inputs = np.concatenate([p.inputs for p in pieces])
    plateaus = []
    for name, column, low, high in zip(area.names, area.columns, area.idle, area.full, strict=True):
        x = inputs[:, column]
        size = Limits.end * (high - low) if np.isfinite(high) else 0.0
        top, bottom = float(np.mean(x >= high - size)), float(np.mean(x <= low + size))
        if max(top, bottom) > Limits.limit_share:
            side = "upper" if top > bottom else "lower"
            yield notice("command-saturated", name, end=side, share=max(top, bottom))
        values, counts = np.unique(x, return_counts=True)
        for end, beside, side in ((-1, -2, "above"), (0, 1, "below")):
            at, share = float(values[end]), float(counts[end]) / x.size
            inside = low < at < high and values.size > Limits.values
            if inside and share > Limits.limit_share and counts[end] > Limits.contrast * counts[beside]:
                plateaus.append(notice("command-limited", name, side=side, limit=at, share=share))
    yield from plateaus


def _unexcited(vehicle: Vehicle, pieces: Sequence[Piece]) -> Iterator[Notice]:
    for rate, (axis, moment) in AXES.items():
        column = vehicle.outputs.index(rate)
        spread = max(_largest_rms(p.whole[:, column], p.dt) for p in pieces)
        sigma = getattr(vehicle.file.sensors, rate).sigma
        if spread < Limits.motion * sigma:
            yield notice("axis-not-excited", axis, rms=spread, noise=sigma, inertia=f"inertia.{moment}")
    total = [_spins(vehicle, p).sum(axis=0) for p in pieces]
    mean = float(np.mean(np.concatenate(total)))
    change = max(_largest_rms(t, p.dt) for t, p in zip(total, pieces, strict=True))
    if change < Limits.lift_change * mean:
        yield notice("lift-not-excited", change=change / mean)


def _largest_rms(x: FloatArray, dt: float) -> float:
    """Return the largest rms about the mean in a burst anywhere: a pulse is as informative in a long window as in a short one."""
    known = x[np.isfinite(x)]
    long = max(2, round(Limits.burst / dt))
    parts = [known[i : i + long] for i in range(0, max(known.size - long // 2, 1), max(long // 2, 1))]
    return max((float(np.std(part)) for part in (*parts, known) if part.size), default=0.0)


def _spins(vehicle: Vehicle, piece: Piece) -> FloatArray:
    """Return x of every rotor (rotors, n), before lag and delay."""
    rows = np.repeat(vehicle.parameter_rows(piece.changes), len(piece.time), axis=1)
    return np.array([vehicle.commanded(name, rows, piece.inputs.T) for name in vehicle.rotors])


def _off(vehicle: Vehicle, piece: Piece) -> BoolArray:
    """Return where no rotor carries anything (n,); nowhere of a vehicle with a wing, which does."""
    if any(vehicle.terms.values()):
        return np.zeros(len(piece.time), dtype=bool)
    spins = _spins(vehicle, piece)
    full = 1.0 if vehicle.drive == "command" else float(spins.max())
    return np.asarray(spins.max(axis=0) <= Limits.off * max(full, 1e-12))
