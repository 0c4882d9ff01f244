"""What is exported: a vehicle file, or the folder of an identification with its flight and what it knows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.errors import StoopError
from stoop.export.record import Record, without_turbulence
from stoop.export.state_space import ParameterCovariance
from stoop.problem import Piece
from stoop.problem.prepare import prepare
from stoop.problem.windows import Window
from stoop.results.result import Result
from stoop.vehicle import Vehicle
from stoop.workflow.identified import Identified, read_identified
from stoop.workflow.outputs import RESULT

ALTITUDE: Final = 200.0  #: m, where no flight says another


@dataclass(frozen=True, eq=False)
class Maneuver:
    """A stretch of flight.

    Attributes
    ----------
    title : str
    record : Record
        What flies.
    measured : (n, n_y), optional
        What the instruments read, NaN where nothing.
    loaded : bool
        Whether it flew with numbers of a loading in place of the vehicle file's own.
    """

    title: str
    record: Record
    measured: FloatArray | None = None
    loaded: bool = False


@dataclass(frozen=True, eq=False)
class Subject:
    """What is exported.

    Attributes
    ----------
    vehicle : Vehicle
    known : ParameterCovariance, optional
        Its numbers' covariance.
    maneuvers : tuple of Maneuver
        Of the flight that it was identified from.
    altitude : float, m
    density : float, kg/m3, optional
        Of that flight.
    notes : tuple of str
    """

    vehicle: Vehicle
    known: ParameterCovariance | None = None
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
    if path.is_dir() or path.name == RESULT:
        return _identified(read_identified(path))
    vehicle, notices = without_turbulence(resolve_vehicle(text))
    return Subject(vehicle, notes=tuple(map(str, notices)))


def _identified(found: Identified) -> Subject:
    vehicle, notices = without_turbulence(found.vehicle)
    notes = tuple(map(str, notices))
    covariance = found.result.covariance
    known = _known_of(vehicle, covariance.names, covariance.matrix)
    subject = Subject(vehicle, known, notes=notes)
    try:
        return _with_flights(subject, found)
    except StoopError as error:
        return replace(subject, notes=(*notes, f"No comparison with the flight: {error}."))


def _known_of(vehicle: Vehicle, names: Sequence[str], covariance: FloatArray) -> ParameterCovariance | None:
    """Return what is known of the numbers that the vehicle has; those of its gusts left with them."""
    kept = [i for i, name in enumerate(names) if name in vehicle.rows]
    return (
        ParameterCovariance(tuple(names[i] for i in kept), covariance[np.ix_(kept, kept)]) if kept else None
    )


def _with_flights(subject: Subject, found: Identified) -> Subject:
    flights, result, vehicle = found.flights(), found.result, subject.vehicle
    windows = [Window(m.flight, m.start, m.stop, m.loading or None) for m in result.maneuvers]
    parts = [prepare(vehicle, flights, [window]).pieces for window in windows]
    maneuvers = [
        _maneuver(vehicle, result, window, index, segment, piece)
        for index, (window, pieces) in enumerate(zip(windows, parts, strict=True))
        for segment, piece in enumerate(pieces)
    ]
    first = parts[0][0]
    logged = "density" in vehicle.inputs
    density = float(np.mean(first.inputs[:, vehicle.inputs.index("density")])) if logged else None
    return replace(subject, maneuvers=tuple(maneuvers), altitude=first.start["h"], density=density)


def _maneuver(
    vehicle: Vehicle, result: Result, window: Window, index: int, segment: int, piece: Piece
) -> Maneuver:
    """Put the estimated start and biases of a fitted maneuver in place of those that are read off the flight."""
    start = dict(piece.start)
    for initial in result.initial_states:
        if (initial.maneuver, initial.segment) == (index, segment):
            start |= {name: q.estimate for name, q in initial.values.items()}
    loaded = {name: {"value": value} for name, value in piece.changes.items()}
    changes = loaded | {
        f"sensors.{channel}.bias": {"value": q.estimate}
        for biases in result.biases
        if biases.maneuver == index
        for channel, q in biases.values.items()
    }
    role = result.maneuvers[index].role
    span = f"{piece.time[0]:.2f} to {piece.time[-1]:.2f} s"
    title = f"{window.flight}, {span} ({'fitted' if role == 'fit' else 'predicted'})"
    record = Record(vehicle.with_numbers(changes), start, piece.time, piece.inputs)
    return Maneuver(title, record, piece.measured, bool(piece.changes))
