"""A unit flown by FMPy beside our own simulation."""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.errors import StoopError, one_line
from stoop.exporters.reference_flight import ReferenceFlight, slopes
from stoop.vehicle.vehicle import slope_input

INSTALL: Final = "pip install 'stoop[fmi]'"


def installed() -> bool:
    """Return whether FMPy is there."""
    return importlib.util.find_spec("fmpy") is not None


def fly_unit(place: Path, flight: ReferenceFlight) -> FloatArray:
    """Return the readings (n, n_y) of a unit at the samples of a flight, by FMPy with a communication step per sample.

    Raises
    ------
    StoopError
        FMPy is not installed, or the unit has no library for this platform.
    """
    try:
        import fmpy as imported
    except ModuleNotFoundError:
        raise StoopError(f"FMPy: the package is not installed; {INSTALL}") from None
    fmpy: Any = imported
    vehicle = flight.vehicle
    known = {v.name for v in fmpy.read_model_description(str(place)).modelVariables}
    names = [n for n in vehicle.inputs if n in known and slope_input(n) in known]
    columns = [vehicle.inputs.index(n) for n in names]
    signals = np.zeros(
        len(flight.time), dtype=[(n, float) for n in ("time", *names, *map(slope_input, names))]
    )
    rates = slopes(flight.inputs, flight.dt)
    for name, column in zip(names, columns, strict=True):
        signals[name], signals[slope_input(name)] = flight.inputs[:, column], rates[:, column]
    out = np.full(flight.readings.shape, np.nan)
    unpacked = fmpy.extract(str(place))
    try:
        for part in flight.parts():
            local = signals[part].copy()
            local["time"] = flight.time[part] - flight.time[part.start]
            start = {
                f"start.{n}": x
                for n, x in zip(vehicle.states, flight.states[part.start].tolist(), strict=True)
            }
            found = fmpy.simulate_fmu(
                unpacked, stop_time=float(local["time"][-1]), step_size=flight.dt, output_interval=flight.dt,
                input=local, output=list(vehicle.outputs), start_values=start, fmi_type="CoSimulation",
            )  # fmt: skip
            out[part] = np.column_stack([found[n] for n in vehicle.outputs])
    except Exception as error:  # FMPy raises Exception itself
        raise StoopError(f"FMPy: {one_line(str(error))}") from None
    finally:
        shutil.rmtree(unpacked, ignore_errors=True)
    return out
