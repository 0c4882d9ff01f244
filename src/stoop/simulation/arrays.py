"""Simulation of inputs given as arrays, a dataset, a flight or a maneuver."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.text import nearest
from stoop.errors import ManeuverError, SimulationError
from stoop.flight import Flight
from stoop.simulation.fly import open_loop, record, simulate_flight
from stoop.simulation.maneuver import Maneuver, load_maneuver
from stoop.simulation.mixing import mixed_inputs
from stoop.simulation.steady import Trim
from stoop.simulation.trim import trim
from stoop.vehicle import Vehicle

if TYPE_CHECKING:
    import xarray as xr

UNIFORM = 1e-6  #: of the time step, by which steps may differ


def simulate(
    vehicle: Vehicle,
    inputs: Maneuver | str | Path | Mapping[str, Any] | xr.Dataset | Flight,
    time: FloatArray | None = None,
    *,
    airspeed: float | None = None,
    altitude: float = 200.0,
    seed: int = 0,
    noise: bool = False,
    name: str = "simulated",
) -> Flight:
    """Simulate a vehicle from trimmed flight.

    Parameters
    ----------
    vehicle : Vehicle
    inputs : Maneuver, path of a maneuver file, mapping of str to (n,) array, xarray.Dataset, or Flight
        Arrays by recorded channel, as a log holds them, or by control: deflection, rad. What is not given stays at its
        trimmed value. Open loop; only a maneuver is flown by the autopilot that a hovering vehicle needs.
    time : (n,) array, s, optional
        At one rate; needed where `inputs` has no ``time``.
    airspeed : float, m/s, optional
        Of the trimmed flight, V* of the vehicle file when absent.
    altitude : float, m
    seed : int
        Of gusts and sensor noise.
    noise : bool
        Of the sensors, with the standard deviations of the vehicle file.
    name : str

    Returns
    -------
    Flight

    Raises
    ------
    ManeuverError
        An input that the vehicle does not have, of another length than the time, or not finite.
    SimulationError
        No trim, or the flight diverges.
    """
    if isinstance(inputs, str | Path):
        inputs = load_maneuver(inputs)
    if isinstance(inputs, Maneuver):
        return simulate_flight(vehicle, inputs, seed, noise, name)
    time, columns = _columns(vehicle, inputs, time)
    point = trim(vehicle, airspeed, altitude)
    gusts = np.random.default_rng([seed, 1])
    flown = open_loop(
        vehicle, time, _channels(vehicle, point, columns, len(time)), point, gusts, vehicle.has_rotors
    )
    if not np.isfinite(flown.outputs).all():
        last = time[int(np.argmin(np.isfinite(flown.outputs).all(axis=1)))]
        raise SimulationError(f"{vehicle.where}: the flight diverges at {last:.2f} s; reduce the inputs")
    sigma = np.array([getattr(vehicle.file.sensors, c).sigma for c in vehicle.outputs]) * float(noise)
    return record(vehicle, flown, sigma, altitude, seed, name, {} if noise else None)


def _columns(
    vehicle: Vehicle, inputs: Mapping[str, Any] | xr.Dataset | Flight, time: FloatArray | None
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return the time from zero on, and the inputs that the vehicle has."""
    table: Any = inputs.data if isinstance(inputs, Flight) else inputs
    known = (*vehicle.recorded, *vehicle.controls)
    recorded = isinstance(inputs, Flight) or hasattr(table, "data_vars")  # which hold measurements as well
    if time is None and "time" not in table:
        raise ManeuverError("inputs: no time is given; add time, seconds at one rate")
    clock = np.asarray(table["time"] if time is None else time, dtype=np.float64)
    steps = np.diff(clock)
    if (
        clock.ndim != 1
        or clock.size < 2
        or not np.allclose(steps, steps[0], rtol=UNIFORM, atol=0.0)
        or not steps[0] > 0.0
    ):
        raise ManeuverError(
            "inputs: the time does not run on at one rate; interpolate the inputs to equal steps"
        )
    columns = {}
    for key in table:
        if key == "time" or (recorded and key not in known):
            continue
        if key not in known:
            raise ManeuverError(f"inputs: {vehicle.where} has no input '{key}'; {nearest(str(key), known)}")
        columns[str(key)] = np.asarray(table[key], dtype=np.float64)
        if columns[str(key)].shape != clock.shape or not np.isfinite(columns[str(key)]).all():
            raise ManeuverError(
                f"inputs: '{key}' is not finite, or not as long as the time ({clock.size} samples)"
            )
    return np.arange(clock.size, dtype=np.float64) * float(steps.mean()), columns


def _channels(vehicle: Vehicle, point: Trim, columns: Mapping[str, FloatArray], count: int) -> FloatArray:
    """Return recorded channels (n, n_u): as given, from deflections, or as in the trim."""
    out = np.repeat(point.inputs[None, :], count, axis=0)
    for control in (c for c in columns if c not in vehicle.recorded):
        moved = {**point.deflections, control: point.deflections[control] + 1.0}
        unit = mixed_inputs(vehicle, moved, point.inputs) - point.inputs
        out += np.outer(columns[control] - point.deflections[control], unit)
    for channel in (c for c in columns if c in vehicle.recorded):
        out[:, vehicle.recorded.index(channel)] = columns[channel]
    return out
