"""A vehicle or an identification, read for an export, and the files of an export, written all or none."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stoop.base.files import check_targets, make_folder, write_files
from stoop.errors import StoopError
from stoop.exporters.exporter import Exported, ModelData
from stoop.exporters.jsbsim_flight import Record, without_turbulence
from stoop.problem import Piece
from stoop.problem.prepare import prepare
from stoop.problem.windows import Window
from stoop.results.result import Result
from stoop.simulation.derivatives import ParameterCovariance
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop.workflow.outputs import RESULT, read_identified
from stoop.workflow.summary import refusal


def read_model(text: str) -> ModelData:
    """Read a built-in vehicle, a vehicle file, or an identification: its folder or its ``result.json``.

    Raises `StoopError`: it is none of these, or damaged.
    """
    path = Path(text)
    if not (path.is_dir() or path.name == RESULT):
        vehicle, notices = without_turbulence(resolve_vehicle(text))
        return ModelData(vehicle, notes=tuple(map(str, notices)))
    found = read_identified(path)
    vehicle, notices = without_turbulence(found.vehicle)
    notes = tuple(map(str, [*refusal(found.result, text), *notices]))
    covariance = found.result.covariance
    # What is known of the numbers that the vehicle has; those of its gusts are left with them.
    kept = [i for i, name in enumerate(covariance.names) if name in vehicle.rows]
    names = tuple(covariance.names[i] for i in kept)
    matrix = covariance.matrix[np.ix_(kept, kept)].copy()
    for i, name in enumerate(names):  # a standard error that is the prior's is no evidence of the flight
        if not found.result.parameters[name].identifiable:
            matrix[i], matrix[:, i] = np.nan, np.nan
            matrix[i, i] = np.inf
    estimated = ParameterCovariance(names, matrix) if kept else None
    windows = [Window(m.flight, m.start, m.stop, m.loading or None) for m in found.result.maneuvers]
    try:
        flights = found.flights()
        parts = [prepare(vehicle, flights, [window]).pieces for window in windows]
        maneuvers = tuple(
            _maneuver(vehicle, found.result, index, segment, piece)
            for index, pieces in enumerate(parts)
            for segment, piece in enumerate(pieces)
        )
    except StoopError as error:
        return ModelData(vehicle, estimated, notes=(*notes, f"No comparison with the flight: {error}."))
    first, density = parts[0][0], None
    if "density" in vehicle.inputs:
        density = float(np.mean(first.inputs[:, vehicle.inputs.index("density")]))
    return ModelData(vehicle, estimated, maneuvers, first.start["h"], density, notes)


def _maneuver(vehicle: Vehicle, result: Result, index: int, segment: int, piece: Piece) -> Record:
    """Put the estimated start and biases of a fitted maneuver in place of those that are read off the flight."""
    start = dict(piece.start)
    for initial in result.initial_states:
        if (initial.maneuver, initial.segment) == (index, segment):
            start |= {name: q.estimate for name, q in initial.values.items()}
    changes = {name: {"value": value} for name, value in piece.changes.items()}
    changes |= {
        f"sensors.{channel}.bias": {"value": q.estimate}
        for biases in result.biases
        if biases.maneuver == index
        for channel, q in biases.values.items()
    }
    flown = result.maneuvers[index]
    span = f"{piece.time[0]:.2f} to {piece.time[-1]:.2f} s"
    title = f"{flown.flight}, {span} ({'fitted' if flown.role == 'fit' else 'predicted'})"
    vehicle = vehicle.with_numbers(changes)
    return Record(vehicle, start, piece.time, piece.inputs, title, piece.measured, bool(piece.changes))


def write(exported: Exported, folder: Path, overwrite: bool = False) -> None:
    """Write the files, all or none.

    Raises `OutputError`: a file is there already, or the folder cannot be written.
    """
    check_targets(folder, tuple(exported.files), overwrite)
    make_folder(folder)
    write_files(folder, exported.files)
