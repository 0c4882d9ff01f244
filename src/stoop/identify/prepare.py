"""Flights and windows -> pieces, nuisances and what the user should know."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stoop.cost import Nuisance, Piece
from stoop.errors import FlightError, VehicleError
from stoop.flight import Flight, segments
from stoop.identify.windows import Window
from stoop.simulate import START_NAMES
from stoop.vehicle import Vehicle

FloatArray = NDArray[np.float64]
FIRST = 0.2  #: s; the stretch of measurements from which an initial state is guessed
START_SCALES = {
    "V": 2.0, "alpha": 0.1, "beta": 0.1, "p": 0.2, "q": 0.2, "r": 0.2, "phi": 0.1, "theta": 0.1, "psi": 0.1,
}  #: m/s, rad, rad/s: prior standard deviation of an initial state about its guess, deliberately wide  # fmt: skip
LAG_SCALE = 0.1  #: rad


@dataclass(frozen=True, eq=False)
class Prepared:
    """Windows cut into pieces.

    Attributes
    ----------
    windows : tuple of Window
        One per maneuver.
    pieces : tuple of Piece
    notes : tuple of str
        What was trimmed, split or dropped.
    """

    windows: tuple[Window, ...]
    pieces: tuple[Piece, ...]
    notes: tuple[str, ...]

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
    notes: list[str] = []
    for index, window in enumerate(windows):
        cut, said = _pieces(vehicle, flights[window.flight], window, index)
        pieces += cut
        notes += said
    return Prepared(tuple(windows), tuple(pieces), tuple(notes))


def _pieces(vehicle: Vehicle, flight: Flight, window: Window, index: int) -> tuple[list[Piece], list[str]]:
    inputs = [name for name in vehicle.inputs if name != "none"]
    found, notes = segments(flight, window.start, window.stop, inputs, vehicle.outputs, _extras(flight))
    if not any(np.isfinite(s.z).any() for s in found):
        raise FlightError(
            f"{window}: none of {', '.join(vehicle.outputs)} was recorded there; choose another window"
        )
    changes = _loading(vehicle, window)
    out = []
    for s in found:
        u = s.u if inputs else np.zeros((len(s.t), 1))
        start = guess_start(vehicle, s.t, s.z)
        start["h"] = _altitude(vehicle, window, s.extras)
        out.append(Piece(index, s.t, np.ascontiguousarray(u), s.z, start, changes))
    return out, notes


def _extras(flight: Flight) -> tuple[str, ...]:
    return ("altitude",) if "altitude" in flight.data else ()


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


def _altitude(vehicle: Vehicle, window: Window, extras: Mapping[str, FloatArray]) -> float:
    seen = extras.get("altitude", np.empty(0))
    seen = seen[np.isfinite(seen)]
    if seen.size:
        return float(seen[: max(1, seen.size // 10)].mean())
    if vehicle.file.environment.density == "standard":
        raise FlightError(
            f"{window}: no altitude was recorded; write environment.density as a number in {vehicle.where}"
        )
    return 0.0


def guess_start(vehicle: Vehicle, t: FloatArray, z: FloatArray) -> dict[str, float]:
    """Guess the state at the first sample from a line through the first 0.2 s of each channel.

    Parameters
    ----------
    t : (n,), s
    z : (n, n_y), NaN where missing
    """
    start = dict.fromkeys(START_NAMES, 0.0)
    start["V"] = vehicle.value("reference.airspeed")
    for i, channel in enumerate(vehicle.outputs):
        if channel in START_SCALES:
            value = _line_at_start(t, z[:, i], channel in ("phi", "psi"))
            start[channel] = start[channel] if value is None else value
    return start


def _line_at_start(t: FloatArray, y: FloatArray, angle: bool) -> float | None:
    seen = np.isfinite(y) & (t <= t[0] + FIRST)
    if not seen.any():
        return None
    early, values = t[seen] - t[0], np.unwrap(y[seen]) if angle else y[seen]
    if seen.sum() < 4:
        return float(values[0])
    return float(np.polyfit(early, values, 1)[1])


def nuisances(vehicle: Vehicle, prepared: Prepared) -> tuple[Nuisance, ...]:
    """Return what differs between maneuvers: initial states of every piece, free biases of every maneuver."""
    out: list[Nuisance] = []
    for i, piece in enumerate(prepared.pieces):
        for name in _start_names(vehicle):
            scale = START_SCALES.get(name, LAG_SCALE)
            out.append(Nuisance(name, piece.maneuver, i, piece.start.get(name, 0.0), scale))
    for maneuver in range(len(prepared.windows)):
        out += [n for n in _biases(vehicle, maneuver) if _observed(prepared, maneuver, vehicle, n.name)]
    return tuple(out)


def _start_names(vehicle: Vehicle) -> tuple[str, ...]:
    rigid = {"longitudinal": ("V", "alpha", "q", "theta"), "lateral": ("beta", "p", "r", "phi", "psi")}
    lags = tuple(s for s in vehicle.states if s.endswith(".lag"))
    return (*rigid.get(vehicle.reduce, tuple(START_SCALES)), *lags)


def _biases(vehicle: Vehicle, maneuver: int) -> list[Nuisance]:
    free = {p.name: p for p in vehicle.parameters if p.free}
    names = [f"sensors.{c}.bias" for c in vehicle.outputs]
    return [
        Nuisance(n, maneuver, None, free[n].value, free[n].prior or 0.1 * (free[n].upper - free[n].lower))
        for n in names
        if n in free
    ]


def _observed(prepared: Prepared, maneuver: int, vehicle: Vehicle, name: str) -> bool:
    channel = vehicle.outputs.index(name.split(".")[1])
    return any(np.isfinite(p.measured[:, channel]).any() for p in prepared.pieces if p.maneuver == maneuver)
