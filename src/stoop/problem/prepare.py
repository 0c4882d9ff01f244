"""Flights and windows -> pieces, nuisances and what the user should know."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice
from stoop.errors import FlightError, VehicleError
from stoop.flight import Flight, Segment, segments
from stoop.flight.segmentation import MIN_SEGMENT
from stoop.problem import Nuisance, Piece
from stoop.problem.start import first_complete, guess_start, state_channels
from stoop.problem.windows import Window
from stoop.simulate import parameter_rows
from stoop.simulate.initial import commanded
from stoop.vehicle import Vehicle

START_SCALES = {
    "V": 2.0, "alpha": 0.1, "beta": 0.1, "p": 0.2, "q": 0.2, "r": 0.2, "phi": 0.1, "theta": 0.1, "psi": 0.1,
}  #: m/s, rad, rad/s: prior standard deviation of an initial state about its guess, deliberately wide  # fmt: skip
GROUND_SCALES = {
    "u": 5.0, "v": 5.0, "w": 2.0, **{n: START_SCALES[n] for n in ("p", "q", "r", "phi", "theta", "psi")},
}  #: likewise, of a vehicle with rotors: its speed through the air is known as well as the wind  # fmt: skip
LAG_SCALE = 0.1  #: rad; of a rotor, share of its largest x
DEFAULTED = "not recorded at the start; a default is used there"


@dataclass(frozen=True, eq=False)
class Prepared:
    """Windows cut into pieces.

    Attributes
    ----------
    windows : tuple of Window
        One per maneuver.
    pieces : tuple of Piece
    notes : tuple of Notice or str
        What was trimmed, split or dropped.
    warnings : tuple of str
        What makes the result doubtful.
    """

    windows: tuple[Window, ...]
    pieces: tuple[Piece, ...]
    notes: tuple[Notice | str, ...]
    warnings: tuple[str, ...] = ()

    def of_maneuver(self, maneuver: int) -> list[int]:
        """Return the indices of a maneuver's pieces."""
        return [i for i, p in enumerate(self.pieces) if p.maneuver == maneuver]


def prepare(vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window]) -> Prepared:
    """Cut windows out of flights.

    Raises
    ------
    FlightError
        A channel that the vehicle needs is not in the flight, or nothing observable is.
    """
    pieces: list[Piece] = []
    notes: list[Notice | str] = []
    for index, window in enumerate(windows):
        cut, said = _pieces(vehicle, flights[window.flight], window, index)
        pieces += cut
        notes += said
    return Prepared(tuple(windows), tuple(pieces), tuple(notes))


def _pieces(
    vehicle: Vehicle, flight: Flight, window: Window, index: int
) -> tuple[list[Piece], list[Notice | str]]:
    inputs = list(vehicle.recorded)
    extras = _extras(vehicle, flight)
    flight = with_average_voltage(vehicle, flight)
    found, cut = segments(flight, window.start, window.stop, inputs, vehicle.outputs, extras)
    notes: list[Notice | str] = [*cut]
    if not any(np.isfinite(s.z).any() for s in found):
        raise FlightError(
            f"{window}: none of {', '.join(vehicle.outputs)} was recorded there; choose another window"
        )
    changes = _loading(vehicle, window)
    out = []
    for segment in found:
        piece, said = _piece(vehicle, window, segment, index, changes)
        out += [piece] if piece is not None else []
        notes += said
    if not out:
        raise FlightError(
            f"{window}: nowhere {MIN_SEGMENT:g} s in which its whole state was measured; choose another window"
        )
    return out, notes


def with_average_voltage(vehicle: Vehicle, flight: Flight) -> Flight:
    """Return the flight with a voltage as slow as the vehicle's rotors take it (`rotors.voltage_average`).

    A battery sags while motors pull. That goes with the command and is in the thrust's polynomial already; and it is
    quicker than most logs hold the voltage. What is left over many seconds is how far the battery is drained.
    """
    rotors = vehicle.file.rotors
    if rotors is None or rotors.voltage_average is None or "voltage" not in flight.data:
        return flight
    volts = flight.column("voltage")
    there = np.isfinite(volts)
    sums = np.concatenate([[[0.0, 0.0]], np.cumsum(np.column_stack([np.nan_to_num(volts), there]), axis=0)])
    half = round(0.5 * rotors.voltage_average * flight.rate)
    k = np.arange(len(volts))
    total, count = (sums[np.minimum(k + half + 1, len(volts))] - sums[np.maximum(k - half, 0)]).T
    mean = np.where(there, total / np.maximum(count, 1.0), np.nan)
    return replace(flight, data=flight.data.assign(voltage=("time", mean, flight.data["voltage"].attrs)))


def _piece(
    vehicle: Vehicle, window: Window, segment: Segment, index: int, changes: dict[str, float]
) -> tuple[Piece | None, list[str]]:
    """Make a piece that begins where the state can be read off the measurements; None where little is left."""
    blank = np.full(len(segment.t), np.nan)
    columns = dict(zip(vehicle.outputs, segment.z.T, strict=True)) | dict(segment.extras)
    readings = {c: columns.get(c, blank) for c in state_channels(vehicle)}
    first = first_complete(readings)
    notes = [f"{window}: begins at {segment.t[first]:.2f} s, where its state was measured"] if first else []
    t = segment.t[first:]
    if t[-1] - t[0] < 0.9 * MIN_SEGMENT:
        return None, [
            f"{window}: {segment.t[0]:.2f}:{segment.t[-1]:.2f} was dropped: its state was measured too late"
        ]
    start, missing = guess_start(vehicle, t, {c: v[first:] for c, v in readings.items()}, str(window))
    if missing:
        notes.append(f"{window}: {', '.join(missing)} {DEFAULTED}")
    start["h"] = _altitude(vehicle, window, segment.extras, first)
    u = np.zeros((len(t), len(vehicle.inputs)))  # zeros: what is no channel, and the noise behind gusts
    u[:, : segment.u.shape[1]] = segment.u[first:]
    return Piece(index, t, np.ascontiguousarray(u), segment.z[first:], start, changes), notes


def _extras(vehicle: Vehicle, flight: Flight) -> tuple[str, ...]:
    wanted = ("altitude", *(c for c in state_channels(vehicle) if c not in vehicle.outputs))
    return tuple(name for name in wanted if name in flight.data)


def _loading(vehicle: Vehicle, window: Window) -> dict[str, float]:
    if window.loading is None:
        return {}
    loadings = vehicle.file.loadings
    if window.loading not in loadings:
        raise VehicleError(
            f"{vehicle.where}: no loading is called '{window.loading}'; loadings are {', '.join(loadings) or 'none'}"
        )
    changes = dict(loadings[window.loading])
    for name in changes:
        if vehicle.parameters[vehicle.rows[name]].free:  # its estimate would stand in for the loading's value
            raise VehicleError(
                f"{vehicle.where}: loadings.{window.loading}.{name}: the number is free, so one estimate holds for all "
                f"maneuvers; remove it from the loading or use --fix {name}"
            )
    return changes


def _altitude(vehicle: Vehicle, window: Window, extras: Mapping[str, FloatArray], first: int) -> float:
    recorded = extras.get("altitude", np.empty(0))[first:]
    seen = recorded[np.isfinite(recorded)]
    if seen.size:
        return float(seen[0])
    if vehicle.file.environment.density == "standard":
        raise FlightError(
            f"{window}: no altitude was recorded; write environment.density as a number in {vehicle.where}"
        )
    return 0.0


def nuisances(vehicle: Vehicle, prepared: Prepared) -> tuple[Nuisance, ...]:
    """Return what differs between maneuvers: initial states of every piece, free biases of every maneuver."""
    out: list[Nuisance] = []
    for i, piece in enumerate(prepared.pieces):
        for name in _start_names(vehicle):
            scale = _start_scale(vehicle, piece, name)
            out.append(Nuisance(name, piece.maneuver, i, piece.start.get(name, 0.0), scale))
    for maneuver in range(len(prepared.windows)):
        out += [n for n in _biases(vehicle, maneuver) if _observed(prepared, maneuver, vehicle, n.name)]
    return tuple(out)


def _start_names(vehicle: Vehicle) -> tuple[str, ...]:
    rigid = {"longitudinal": ("V", "alpha", "q", "theta"), "lateral": ("beta", "p", "r", "phi", "psi")}
    lags = tuple(s for s in vehicle.states if s.endswith(".lag"))
    whole = tuple(GROUND_SCALES if vehicle.hovers else START_SCALES)
    return (*rigid.get(vehicle.reduce, whole), *lags)


def _start_scale(vehicle: Vehicle, piece: Piece, name: str) -> float:
    """Return the prior standard deviation of one initial state about its guess."""
    rotor = name.removesuffix(".lag")
    if rotor not in vehicle.rotors:
        return (START_SCALES | GROUND_SCALES).get(name, LAG_SCALE)
    rows = parameter_rows(vehicle, piece.changes)
    spin = commanded(vehicle, rotor, np.repeat(rows, len(piece.inputs), axis=1), piece.inputs.T)
    return LAG_SCALE * float(np.max(spin)) or LAG_SCALE * vehicle.value("rotors.gain")


def _biases(vehicle: Vehicle, maneuver: int) -> list[Nuisance]:
    free = {p.name: p for p in vehicle.parameters if p.free}
    names = [f"sensors.{c}.bias" for c in vehicle.outputs if f"sensors.{c}.bias" in free]
    for name in names:
        if getattr(vehicle.file.sensors, name.split(".")[1]).bias.bounds is not None:
            raise VehicleError(
                f"{vehicle.where}: {name}: a bias takes no bounds; write prior = SIGMA instead"
            )
    return [Nuisance(n, maneuver, None, free[n].value, free[n].prior or 1.0) for n in names]


def _observed(prepared: Prepared, maneuver: int, vehicle: Vehicle, name: str) -> bool:
    channel = vehicle.outputs.index(name.split(".")[1])
    return any(np.isfinite(p.measured[:, channel]).any() for p in prepared.pieces if p.maneuver == maneuver)
