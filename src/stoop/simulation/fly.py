"""Fly a maneuver: a simulated flight, with sensor noise, as a flight file holds it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.rotations import to_ground
from stoop.errors import ManeuverError, SimulationError
from stoop.flight import VARIABLES, Flight, from_columns
from stoop.simulation.check import check_maneuver, on_rotors
from stoop.simulation.delays import late_inputs, late_outputs
from stoop.simulation.hover import steady_wind
from stoop.simulation.initial import commanded, initial_states, parameter_rows, rigid_states
from stoop.simulation.maneuver import Maneuver
from stoop.simulation.mixing import mixed_inputs
from stoop.simulation.on_rotors import fly_on_rotors
from stoop.simulation.paths import readings_along, states_flown, traveled
from stoop.simulation.rotors import channel_range
from stoop.simulation.steady import Trim
from stoop.simulation.trim import trim
from stoop.simulation.turbulence import gust_start, outputs_in_turbulence
from stoop.vehicle import Vehicle
from stoop.vehicle.schema import CHANNELS, WIND
from stoop.vehicle.vehicle import WIND_NUMBERS

GROUND_SPEED_NOISE = 0.1  #: of the velocity over ground that an aircraft records in a wind, m/s
HEIGHT_PASSES, HEIGHT_TOLERANCE = 50, 1e-9  #: of the fixed point of height and trajectory; m
_GUSTS, _VELOCITY = 1, 2  #: which stream of the seed


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
    velocity : (n, 3) or None, m/s
        Over ground, north-east-down; of aircraft only where the maneuver has a wind.
    clipped : (n, m) or None
        On rotors: where a channel was held at an end of its range.
    """

    trim: Trim
    time: FloatArray
    inputs: FloatArray
    outputs: FloatArray
    velocity: FloatArray | None = None
    clipped: NDArray[np.bool_] | None = None


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
    check_maneuver(vehicle, maneuver)
    point = flown_trim(vehicle, maneuver)
    gusts = np.random.default_rng([seed, _GUSTS])
    flown = (_on_rotors if on_rotors(vehicle, maneuver) else _on_wings)(vehicle, maneuver, point, gusts)
    if not np.isfinite(flown.outputs).all():
        last = maneuver.time[int(np.argmin(np.isfinite(flown.outputs).all(axis=1)))]
        faster = "raise the rate of the maneuver, " if on_rotors(vehicle, maneuver) else ""
        raise SimulationError(
            f"{vehicle.where}: the flight diverges at {last:.2f} s; {faster}reduce the amplitude or check the vehicle's stability"
        )
    return flown


def flown_trim(vehicle: Vehicle, maneuver: Maneuver) -> Trim:
    """Return the steady flight that a maneuver begins with."""
    if on_rotors(vehicle, maneuver):
        return trim(
            vehicle,
            altitude=maneuver.altitude,
            velocity=maneuver.velocity,
            wind=maneuver.wind,
            heading=maneuver.heading,
        )
    point = trim(vehicle, maneuver.airspeed, maneuver.altitude)
    wind = tuple(steady_wind(vehicle, maneuver.wind).tolist())
    known = dict(zip(WIND_NUMBERS, wind, strict=True)) if set(WIND_NUMBERS) <= vehicle.rows.keys() else {}
    return replace(
        point, start={**point.start, "psi": maneuver.heading}, changes={**point.changes, **known}, wind=wind
    )


def _on_wings(vehicle: Vehicle, maneuver: Maneuver, point: Trim, gusts: np.random.Generator) -> Flown:
    """Fly without an autopilot."""
    inputs = flown_inputs(vehicle, maneuver, point)
    moving = vehicle.has_rotors or maneuver.wind is not None
    return open_loop(vehicle, maneuver.time, inputs, point, gusts, moving)


def open_loop(
    vehicle: Vehicle,
    time: FloatArray,
    inputs: FloatArray,
    point: Trim,
    gusts: np.random.Generator,
    over_ground: bool,
) -> Flown:
    """Fly recorded channels (n, n_u) from a trim, without sensor noise.

    Parameters
    ----------
    time : (n,), s
        At one rate.
    over_ground : bool
        Whether the velocity over ground is wanted.
    """
    dt, rows = float(time[1] - time[0]), parameter_rows(vehicle, point.changes)
    start = initial_states(vehicle, {**point.start, **gust_start(vehicle, gusts)}, rows, inputs[0])
    state = gusts.bit_generator.state
    _record_height(vehicle, rows, start, inputs, dt, gusts)
    truth = _moving_air(vehicle, rows, start, inputs, dt, gusts)
    velocity = None
    if over_ground:
        gusts.bit_generator.state = state  # the same gusts again
        velocity = _over_ground(vehicle, point, states_flown(vehicle, rows, start, inputs, dt, gusts))
    return Flown(point, time, inputs, late_outputs(vehicle, truth, rows, dt)[0], velocity)


def _record_height(
    vehicle: Vehicle,
    rows: FloatArray,
    start: FloatArray,
    inputs: FloatArray,
    dt: float,
    gusts: np.random.Generator,
) -> None:
    """Fill in the height above the ground that an open-loop flight has: it is an input that follows from the states."""
    if vehicle.file.ground_effect is None:
        return
    column, h = vehicle.inputs.index(vehicle.file.ground_effect.channel), vehicle.states.index("h")
    terrain, state = inputs[:, column] - start[h, 0], gusts.bit_generator.state
    for _ in range(HEIGHT_PASSES):
        gusts.bit_generator.state = state  # the same gusts again
        flown = states_flown(vehicle, rows, start, inputs, dt, gusts)[:, h] + terrain
        change = float(np.max(np.abs(flown - inputs[:, column])))
        inputs[:, column] = flown
        if not change > HEIGHT_TOLERANCE:
            break
    gusts.bit_generator.state = state


def _on_rotors(vehicle: Vehicle, maneuver: Maneuver, point: Trim, gusts: np.random.Generator) -> Flown:
    """Fly with one."""
    dt, rows = 1.0 / maneuver.rate, parameter_rows(vehicle, point.changes)
    flight = fly_on_rotors(vehicle, maneuver, point, gust_start(vehicle, gusts), gusts)
    truth = readings_along(vehicle, rows, flight.states, flight.received)
    outputs = late_outputs(vehicle, truth[None], rows, dt)[0]
    velocity = _over_ground(vehicle, point, flight.states)
    return Flown(point, maneuver.time, flight.inputs, outputs, velocity, flight.clipped)


def _over_ground(vehicle: Vehicle, point: Trim, states: FloatArray) -> FloatArray:
    """Return velocities (n, 3) over ground of states (n, n_x), which are relative to the steady wind."""
    x = dict(zip(vehicle.states, states.T, strict=True))
    zero = np.zeros(len(states))
    body, q = ([x.get(name, zero) for name in names] for names in ("uvw", ("e0", "e1", "e2", "e3")))
    return np.asarray(to_ground(np.column_stack(q), np.column_stack(body)) + np.asarray(point.wind))


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


def flown_inputs(vehicle: Vehicle, maneuver: Maneuver, point: Trim) -> FloatArray:
    """Return the recorded channels (n, n_u) of a maneuver flown from a trim.

    Mixing is affine, so one column per control is enough.
    """
    out = np.repeat(point.inputs[None, :], len(maneuver.time), axis=0)
    for control, move in maneuver.deflections().items():
        if control not in vehicle.controls:  # a channel of its own
            out[:, vehicle.inputs.index(control)] += move
            continue
        unit = mixed_inputs(
            vehicle, {**point.deflections, control: point.deflections[control] + 1.0}, point.inputs
        )
        out += np.outer(move, unit - point.inputs)
    return out


def noise_sigma(vehicle: Vehicle, maneuver: Maneuver) -> FloatArray:
    """Return the noise of each output channel, its own unit."""
    known = dict.fromkeys((*vehicle.outputs, *(WIND if maneuver.wind is not None else ())))
    unknown = set(maneuver.noise) - set(known)
    if unknown:
        raise ManeuverError(f"noise: '{min(unknown)}' is not observed; channels are {', '.join(known)}")
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
    return record(vehicle, flown, sigma, maneuver.altitude, seed, name, maneuver.noise if noise else None)


def record(
    vehicle: Vehicle,
    flown: Flown,
    sigma: FloatArray,
    altitude: float,
    seed: int,
    name: str,
    ground_noise: Mapping[str, float] | None,
) -> Flight:
    """Return what the instruments record of a simulated motion.

    Parameters
    ----------
    sigma : (n_y,)
        Noise of each output, its own unit.
    altitude : float, m
        At the start.
    ground_noise : mapping, optional
        Noise of velocities over ground that are no outputs, m/s, where it is not the usual one; None for no noise.
    """
    measured = flown.outputs + sigma * np.random.default_rng(seed).standard_normal(flown.outputs.shape)
    columns = dict(zip(vehicle.outputs, measured.T, strict=True))
    columns |= {c: flown.inputs[:, i] for i, c in enumerate(vehicle.recorded)}
    rows = parameter_rows(vehicle, flown.trim.changes)
    columns |= {
        c: np.array(commanded(vehicle, c, np.repeat(rows, len(flown.inputs), axis=1), flown.inputs.T))
        for c in vehicle.controls
        if c in VARIABLES and c not in vehicle.inputs  # a recorded channel stays as it was commanded
    }
    if flown.velocity is None:
        columns["altitude"] = _altitude(vehicle, altitude, flown)
    else:
        position = traveled(flown.velocity, float(flown.time[1] - flown.time[0]))
        columns |= dict(zip(("pn", "pe", "pd"), position.T, strict=True))
        columns["altitude"] = altitude - position[:, 2]
        draw = np.random.default_rng([seed, _VELOCITY]).standard_normal(flown.velocity.shape)
        for i, channel in enumerate(WIND):
            if channel not in vehicle.outputs:
                noise = 0.0 if ground_noise is None else ground_noise.get(channel, GROUND_SPEED_NOISE)
                columns[channel] = flown.velocity[:, i] + noise * draw[:, i]
    notices = (notice("simulated", name), *_changed(vehicle, flown), *_saturated(vehicle, flown))
    flight = from_columns(name, flown.time, columns, notices)
    flight.data.attrs["truth"] = json.dumps(
        {p.name: flown.trim.changes.get(p.name, p.value) for p in vehicle.parameters if p.free}
    )
    return flight


def _saturated(vehicle: Vehicle, flown: Flown) -> list[Notice]:
    """Say which rotors could not do what was asked of them."""
    if flown.clipped is None:
        return []
    shares = flown.clipped.mean(axis=0)
    held = [name for name, share in zip(channel_range(vehicle).names, shares, strict=True) if share > 0.0]
    if not held:
        return []
    return [notice("rotors-saturated", rotors=tuple(held), share=float(shares.max()))]


def numbers_set(vehicle: Vehicle, point: Trim) -> dict[str, float]:
    """Return the numbers of the vehicle that a trim had to set to something else than the file says (by 0.1 %)."""
    return {
        name: value
        for name, value in point.changes.items()
        if name not in WIND_NUMBERS and abs(value - vehicle.value(name)) > 1e-3 * abs(vehicle.value(name))
    }


def _changed(vehicle: Vehicle, flown: Flown) -> list[Notice]:
    """Say what the trim set: a fit with the file's own number would put the difference into the drag."""
    return [
        notice(
            "set-by-trim",
            name,
            value=value,
            unit=vehicle.parameters[vehicle.rows[name]].unit,
            airspeed=flown.trim.start["V"],
            given=vehicle.value(name),
        )
        for name, value in numbers_set(vehicle, flown.trim).items()
    ]


def _altitude(vehicle: Vehicle, altitude: float, flown: Flown) -> FloatArray:
    """Integrate the climb rate that the noise-free readings imply, m: gusts count as if the aircraft climbed."""
    y = dict.fromkeys(CHANNELS, np.zeros(len(flown.time))) | dict(
        zip(vehicle.outputs, flown.outputs.T, strict=True)
    )
    rigid = rigid_states({c: y[c] for c in ("V", "alpha", "beta")})
    u, v, w = rigid["u"], rigid["v"], rigid["w"]
    climb = u * np.sin(y["theta"]) - np.cos(y["theta"]) * (v * np.sin(y["phi"]) + w * np.cos(y["phi"]))
    steps = 0.5 * (climb[1:] + climb[:-1]) / (1.0 / float(flown.time[1] - flown.time[0]))
    return altitude + np.concatenate([[0.0], np.cumsum(steps)])
