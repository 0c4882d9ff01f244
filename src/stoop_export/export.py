"""Export of a fitted model or a vehicle; its files are written all or none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from stoop import FittedModel, Vehicle
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import StoopError
from stoop.extend.files import check_targets, make_folder, write_files
from stoop.extend.fits import Piece, Prepared, Result, takes_model_or_vehicle
from stoop.extend.flights import Window
from stoop_analysis.derivatives import ParameterCovariance
from stoop_analysis.draws import POSTERIOR_FILE, draws_of
from stoop_export.exporter import Condition, Exported, ModelData
from stoop_export.jsbsim_flight import Record, without_turbulence
from stoop_export.targets import export as export_data


@takes_model_or_vehicle
def export(
    model: FittedModel | Vehicle,
    to: str,
    folder: str | Path | None = None,
    airspeed: float | None = None,
    altitude: float | None = None,
    climb_angle: float = 0.0,
    overwrite: bool = False,
    draws: int | None = None,
    seed: int = 0,
) -> Exported:
    """Export a model as files of another tool.

    Parameters
    ----------
    model : FittedModel, the folder of one, Vehicle, built-in vehicle or vehicle file
    to : str
        One of the targets of ``stoop export --to``.
    folder : path, optional
        Where the files are written; they are only returned when absent.
    airspeed, altitude : float, m/s and m, optional
        Of the steady flight.
    climb_angle : float, rad
        Likewise.
    overwrite : bool
        Whether files in the folder may be replaced.
    draws : int, optional
        Number of parameter sets for domain randomization, of the posterior where it was sampled, else of the corrected
        covariance within bounds and priors; for targets that are learning simulators.
    seed : int
        Of the draws from the covariance.

    Raises
    ------
    StoopError
        The model cannot be exported so, or the folder holds other files.
    """
    data = model_data(model)
    if draws is not None:
        data = replace(data, draws=_draws(model, draws, seed))
    found = export_data(data, to, Condition(airspeed, altitude, climb_angle))
    if folder is not None:
        write(found, Path(folder), overwrite)
    return found


def _draws(model: FittedModel | Vehicle, count: int, seed: int) -> dict[str, FloatArray]:
    """Return draws of the numbers of a fitted model; raises `StoopError`: there is no fit, or none can be drawn."""
    if isinstance(model, Vehicle):
        raise StoopError(
            f"{model.where}: --draws needs estimates with their errors; give the folder of stoop identify"
        )
    drawn = draws_of(model.result, model.attachments.get(POSTERIOR_FILE), count, seed, where=model.source)
    return drawn.numbers_of(model.vehicle)


def model_data(model: FittedModel | Vehicle) -> ModelData:
    """Return what is exported of a fitted model or a vehicle."""
    if isinstance(model, Vehicle):
        vehicle, notices = without_turbulence(model.without_positions())
        return ModelData(vehicle, notes=tuple(map(str, notices)))
    vehicle, notices = without_turbulence(model.vehicle.without_positions())
    notes = tuple(map(str, [*model.refusal, *notices]))
    covariance = model.result.covariance
    # What is known of the numbers that the vehicle has; those of its gusts are left with them.
    kept = [i for i, name in enumerate(covariance.names) if name in vehicle.rows]
    names = tuple(covariance.names[i] for i in kept)
    matrix = covariance.matrix[np.ix_(kept, kept)].copy()
    for i, name in enumerate(names):  # a standard error that is the prior's is no evidence of the flight
        if not model.result.parameters[name].identifiable:
            matrix[i], matrix[:, i] = np.nan, np.nan
            matrix[i, i] = np.inf
    estimated = ParameterCovariance(names, matrix) if kept else None
    windows = [Window(m.flight, m.start, m.stop, m.loading or None) for m in model.result.maneuvers]
    try:
        flights = model.by_name
        parts = [Prepared.of(vehicle, flights, [window]).pieces for window in windows]
        maneuvers = tuple(
            _maneuver(vehicle, model.result, index, segment, piece)
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
