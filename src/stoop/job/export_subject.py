"""What is exported: a vehicle file, or the folder of an identification with its flight and what it knows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from stoop.cost import Piece
from stoop.errors import OutputError, StoopError
from stoop.export.flown import Record
from stoop.export.state_space import Known
from stoop.export.still import still
from stoop.flight import Flight, load
from stoop.identify.prepare import prepare
from stoop.identify.result import Result, read_result
from stoop.identify.windows import Window
from stoop.job.outputs import RESULT, flight_file
from stoop.vehicle import Vehicle, load_vehicle

FloatArray = NDArray[np.float64]
ALTITUDE: Final = 200.0  #: m, where no flight says another


@dataclass(frozen=True, eq=False)
class Maneuver:
    """A stretch of the flight: what flew, and what its instruments read (n, n_y), NaN where nothing."""

    title: str
    record: Record
    measured: FloatArray


@dataclass(frozen=True, eq=False)
class Subject:
    """What is exported.

    Attributes
    ----------
    vehicle : Vehicle
    known : Known, optional
        Its numbers' covariance.
    maneuvers : tuple of Maneuver
        Of the flight that it was identified from.
    altitude : float, m
    density : float, kg/m3, optional
        Of that flight.
    notes : tuple of str
    """

    vehicle: Vehicle
    known: Known | None = None
    maneuvers: tuple[Maneuver, ...] = ()
    altitude: float = ALTITUDE
    density: float | None = None
    notes: tuple[str, ...] = ()


def read_subject(text: str) -> Subject:
    """Read a built-in vehicle, a vehicle file, or an identification: its folder or its ``result.json``.

    Raises
    ------
    StoopError
        It is none of these, or damaged.
    """
    from stoop.vehicle.builtin import resolve_vehicle

    path = Path(text)
    folder = path.parent if path.name == RESULT else path
    if folder.is_dir():
        return _identified(folder)
    vehicle, notes = still(resolve_vehicle(text))
    return Subject(vehicle, notes=notes)


def _identified(folder: Path) -> Subject:
    if not (folder / RESULT).exists():
        raise OutputError(
            f"{folder}: holds no {RESULT}; name the folder that stoop identify wrote, or a vehicle file"
        )
    result = read_result(folder / RESULT)
    vehicle, notes = still(load_vehicle(folder / "vehicle.toml"))
    vehicle = vehicle.with_numbers({n: {"value": p.estimate} for n, p in result.parameters.items()})
    known = Known(result.covariance.names, result.covariance.matrix)
    flights, missing = _flights(folder, result)
    subject = Subject(vehicle, known if known.names else None, notes=(*notes, *missing))
    return subject if not flights else _with_flights(subject, result, flights)


def _flights(folder: Path, result: Result) -> tuple[dict[str, Flight], tuple[str, ...]]:
    """Return the flights that lie in the folder, and what to say where one does not."""
    names = tuple(dict.fromkeys(m.flight for m in result.maneuvers))
    found: dict[str, Flight] = {}
    for name in names:
        path = folder / flight_file(name, len(names))
        try:
            found[name] = replace(load(path), name=name)
        except StoopError as error:
            return {}, (f"No comparison with the flight: {error}.",)
    return found, ()


def _with_flights(subject: Subject, result: Result, flights: dict[str, Flight]) -> Subject:
    windows = [Window(m.flight, m.start, m.stop) for m in result.maneuvers]
    try:
        parts = [prepare(subject.vehicle, flights, [window]).pieces for window in windows]
    except StoopError as error:
        return replace(subject, notes=(*subject.notes, f"No comparison with the flight: {error}."))
    maneuvers = [
        _maneuver(subject.vehicle, result, window, index, segment, piece)
        for index, (window, pieces) in enumerate(zip(windows, parts, strict=True))
        for segment, piece in enumerate(pieces)
    ]
    first = parts[0][0]
    column = subject.vehicle.inputs.index("density") if "density" in subject.vehicle.inputs else None
    density = None if column is None else float(np.mean(first.inputs[:, column]))
    notes = subject.notes
    if subject.vehicle.file.loadings:
        notes += (
            "The maneuvers are flown with the vehicle file's own loading; a result does not say which was flown.",
        )
    return replace(
        subject, maneuvers=tuple(maneuvers), altitude=first.start["h"], density=density, notes=notes
    )


def _maneuver(
    vehicle: Vehicle, result: Result, window: Window, index: int, segment: int, piece: Piece
) -> Maneuver:
    """Put the estimated start and biases of a fitted maneuver in place of those that are read off the flight."""
    start = dict(piece.start)
    for initial in result.initial_states:
        if (initial.maneuver, initial.segment) == (index, segment):
            start |= {name: q.estimate for name, q in initial.values.items()}
    changes = {
        f"sensors.{channel}.bias": {"value": q.estimate}
        for biases in result.biases
        if biases.maneuver == index
        for channel, q in biases.values.items()
    }
    role = result.maneuvers[index].role
    span = f"{piece.time[0]:.2f} to {piece.time[-1]:.2f} s"
    title = f"{window.flight}, {span} ({'fitted' if role == 'fit' else 'predicted'})"
    record = Record(vehicle.with_numbers(changes), start, piece.time, piece.inputs)
    return Maneuver(title, record, piece.measured)
