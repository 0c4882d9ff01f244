"""Fly a maneuver: a simulated flight, with sensor noise, as a flight file holds it."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stoop.errors import ManeuverError, SimulationError
from stoop.flight import VARIABLES, Flight, from_columns
from stoop.simulate.delays import late_inputs, late_outputs
from stoop.simulate.initial import commanded, initial_states, parameter_rows, rigid_states
from stoop.simulate.maneuver import Maneuver
from stoop.simulate.trim import Trim, mixed_inputs, trim
from stoop.simulate.turbulence import gust_start, outputs_in_turbulence
from stoop.vehicle import Vehicle
from stoop.vehicle.schema import CHANNELS

FloatArray = NDArray[np.float64]
_GUSTS = 1  #: which stream of the seed


@dataclass(frozen=True)
class Flown:
    """What a simulated maneuver was, before an instrument saw it.

    Attributes
    ----------
    time : (n,), s
    inputs : (n, n_u)
        Recorded channels.
    outputs : (n, n_y)
        Noise-free readings in the order of ``vehicle.outputs``.
    """

    trim: Trim
    time: FloatArray
    inputs: FloatArray
    outputs: FloatArray


def fly(vehicle: Vehicle, maneuver: Maneuver, seed: int = 0) -> Flown:
    """Fly a maneuver from trim, without sensor noise; through gusts where the vehicle has some.

    Parameters
    ----------
    vehicle : Vehicle
    maneuver : Maneuver
    seed : int
        Of the gusts.

    Raises
    ------
    ManeuverError
        A control that the vehicle does not have.
    SimulationError
        No trim, or the flight diverges.
    """
    _check_controls(vehicle, maneuver)
    point = trim(vehicle, maneuver.airspeed, maneuver.altitude)
    inputs = flown_inputs(vehicle, maneuver, point)
    rows = parameter_rows(vehicle, point.changes)
    gusts = np.random.default_rng([seed, _GUSTS])
    start = initial_states(vehicle, {**point.start, **gust_start(vehicle, gusts)}, rows, inputs[0])
    dt = 1.0 / maneuver.rate
    truth = _moving_air(vehicle, rows, start, inputs, dt, gusts)
    outputs = late_outputs(vehicle, truth, rows, dt)[0]
    if not np.isfinite(outputs).all():
        last = maneuver.time[int(np.argmin(np.isfinite(outputs).all(axis=1)))]
        raise SimulationError(
            f"{vehicle.where}: the flight diverges at {last:.2f} s; reduce the amplitude or check the vehicle's stability"
        )
    return Flown(point, maneuver.time, inputs, outputs)


def _moving_air(
    vehicle: Vehicle,
    rows: FloatArray,
    start: FloatArray,
    inputs: FloatArray,
    dt: float,
    gusts: np.random.Generator,
) -> FloatArray:
    """Return the readings (1, n, n_y) before any delay of a sensor."""
    if vehicle.gusts:
        return outputs_in_turbulence(vehicle, rows, start, inputs, dt, gusts)
    return vehicle.kernel().trajectories(rows, start, late_inputs(vehicle, inputs, rows, dt), dt)


def _check_controls(vehicle: Vehicle, maneuver: Maneuver) -> None:
    for spec in maneuver.input:
        if spec.control not in vehicle.controls:
            known = ", ".join(vehicle.controls) or "none"
            raise ManeuverError(
                f"{vehicle.where}: the maneuver moves '{spec.control}', but the controls are {known}; correct the maneuver file"
            )


def flown_inputs(vehicle: Vehicle, maneuver: Maneuver, point: Trim) -> FloatArray:
    """Return the recorded channels (n, n_u) of a maneuver flown from a trim.

    Mixing is affine, so one column per control is enough.
    """
    out = np.repeat(point.inputs[None, :], len(maneuver.time), axis=0)
    for control, move in maneuver.deflections().items():
        unit = mixed_inputs(
            vehicle, {**point.deflections, control: point.deflections[control] + 1.0}, point.inputs
        )
        out += np.outer(move, unit - point.inputs)
    return out


def noise_sigma(vehicle: Vehicle, maneuver: Maneuver) -> FloatArray:
    """Return the noise of each output channel, its own unit."""
    unknown = set(maneuver.noise) - set(vehicle.outputs)
    if unknown:
        raise ManeuverError(
            f"noise: '{min(unknown)}' is not observed; channels are {', '.join(vehicle.outputs)}"
        )
    file = vehicle.file.sensors
    return np.array([maneuver.noise.get(c, getattr(file, c).sigma) for c in vehicle.outputs])


def simulate_flight(
    vehicle: Vehicle, maneuver: Maneuver, seed: int = 0, noise: bool = True, name: str = "simulated"
) -> Flight:
    """Return a flight as the instruments of the vehicle would record it.

    Parameters
    ----------
    vehicle : Vehicle
    maneuver : Maneuver
    seed : int
        Of the measurement noise and of the gusts.
    noise : bool
        Of the sensors; gusts blow without it too.
    name : str
        As in ``FLIGHT@START:STOP``.
    """
    flown = fly(vehicle, maneuver, seed)
    sigma = noise_sigma(vehicle, maneuver) * float(noise)
    measured = flown.outputs + sigma * np.random.default_rng(seed).standard_normal(flown.outputs.shape)
    columns = dict(zip(vehicle.outputs, measured.T, strict=True))
    columns |= {c: flown.inputs[:, i] for i, c in enumerate(vehicle.recorded)}
    rows = parameter_rows(vehicle, flown.trim.changes)
    columns |= {
        c: np.array(commanded(vehicle, c, np.repeat(rows, len(flown.inputs), axis=1), flown.inputs.T))
        for c in vehicle.controls
        if c in VARIABLES and c not in vehicle.inputs  # a recorded channel stays as it was commanded
    }
    columns["altitude"] = _altitude(vehicle, maneuver, flown)
    flight = from_columns(name, flown.time, columns, ("simulated flight", *_changed(vehicle, flown)))
    flight.data.attrs["truth"] = json.dumps(
        {p.name: flown.trim.changes.get(p.name, p.value) for p in vehicle.parameters if p.free}
    )
    return flight


def numbers_set(vehicle: Vehicle, point: Trim) -> dict[str, float]:
    """Return the numbers of the vehicle that a trim had to set to something else than the file says (by 0.1 %)."""
    return {
        name: value
        for name, value in point.changes.items()
        if abs(value - vehicle.value(name)) > 1e-3 * abs(vehicle.value(name))
    }


def _changed(vehicle: Vehicle, flown: Flown) -> list[str]:
    """Say what the trim set: a fit with the file's own number would put the difference into the drag."""
    return [
        f"{name} was set to {value:.7g} {vehicle.parameters[vehicle.rows[name]].unit} to hold "
        f"{flown.trim.start['V']:g} m/s; the vehicle file says {vehicle.value(name):.7g}"
        for name, value in numbers_set(vehicle, flown.trim).items()
    ]


def _altitude(vehicle: Vehicle, maneuver: Maneuver, flown: Flown) -> FloatArray:
    """Integrate the climb rate that the noise-free readings imply, m: gusts count as if the aircraft climbed."""
    y = dict.fromkeys(CHANNELS, np.zeros(len(flown.time))) | dict(
        zip(vehicle.outputs, flown.outputs.T, strict=True)
    )
    rigid = rigid_states({c: y[c] for c in ("V", "alpha", "beta")})
    u, v, w = rigid["u"], rigid["v"], rigid["w"]
    climb = u * np.sin(y["theta"]) - np.cos(y["theta"]) * (v * np.sin(y["phi"]) + w * np.cos(y["phi"]))
    steps = 0.5 * (climb[1:] + climb[:-1]) / maneuver.rate
    return maneuver.altitude + np.concatenate([[0.0], np.cumsum(steps)])
