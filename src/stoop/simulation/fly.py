"""Simulated flights: a maneuver, or inputs given as arrays, recorded as the instruments of the vehicle would."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import notice
from stoop.base.text import nearest
from stoop.errors import ManeuverError, SimulationError
from stoop.flight import VARIABLES, Flight, from_columns
from stoop.simulation.maneuver import Maneuver, load_maneuver
from stoop.simulation.on_rotors import Departure, fly_on_rotors
from stoop.simulation.steady_flight import trim
from stoop.simulation.trim import Flown, Trim, traveled
from stoop.vehicle import Vehicle, trajectories
from stoop.vehicle.channels import check_states, rigid_states
from stoop.vehicle.schema import CHANNELS, WIND

if TYPE_CHECKING:
    import xarray as xr

GROUND_SPEED_NOISE: Final = 0.1  #: m/s, of a velocity over ground that the vehicle file has no noise of
HEIGHT_PASSES, HEIGHT_TOLERANCE = 50, 1e-9  #: of the fixed point of height and trajectory; m
ADVICE: Final = "reduce the amplitude or check the vehicle's stability"
GUSTS, _VELOCITY = 1, 2  #: streams of random numbers


def simulate(
    vehicle: Vehicle,
    inputs: Maneuver | str | Path | Mapping[str, Any] | xr.Dataset | Flight,
    time: FloatArray | None = None,
    airspeed: float | None = None,
    altitude: float = 200.0,
    seed: int = 0,
    noise: bool = False,
    name: str = "simulated",
    initial_state: Mapping[str, float] | None = None,
) -> Flight:
    """Simulate a vehicle from trimmed flight: :func:`stoop.simulate`, which has the parameters."""
    if isinstance(inputs, str | Path):
        inputs = load_maneuver(inputs)
    if isinstance(inputs, Maneuver):
        if initial_state is not None:
            raise ManeuverError(
                "initial_state: a maneuver begins in steady flight; give the inputs as arrays"
            )
        return simulate_flight(vehicle, inputs, seed, noise, name)
    time, columns = _columns(vehicle, inputs, time)
    point = trim(vehicle, airspeed, altitude)
    check_states(vehicle, initial_state or {})
    moved = {c: columns[c] - point.deflections[c] for c in columns if c not in vehicle.recorded}
    channels = point.inputs_about(vehicle, moved, len(time))
    for channel in (c for c in columns if c in vehicle.recorded):
        channels[:, vehicle.recorded.index(channel)] = columns[channel]
    gusts = np.random.default_rng([seed, GUSTS])
    begun = replace(point, start={**point.start, **(initial_state or {})})
    moved_alone = _open_loop(vehicle, time, channels, begun, gusts, windy=False)
    flown = _finite(vehicle, moved_alone, "reduce the inputs")
    if isinstance(flown, SimulationError):
        raise flown
    sigma = np.array([getattr(vehicle.file.sensors, c).sigma for c in vehicle.outputs]) * float(noise)
    return _record(vehicle, flown, sigma, altitude, seed, name, {} if noise else None)


def simulate_flight(
    vehicle: Vehicle, maneuver: Maneuver, seed: int = 0, noise: bool = True, name: str = "simulated"
) -> Flight:
    """Return the flight of a maneuver as the instruments of the vehicle would record it.

    Parameters
    ----------
    vehicle : Vehicle
    maneuver : Maneuver
        As of :func:`stoop.load_maneuver`.
    seed : int
        Of the measurement noise and of the gusts.
    noise : bool
        Of the sensors; there are gusts without it too.
    name : str
        As in ``FLIGHT@START:STOP``.

    Returns
    -------
    Flight

    Raises
    ------
    ManeuverError
        A control, or noise of a channel, that the vehicle does not have.
    SimulationError
        No trim, or the flight diverges.
    """
    flown = fly(vehicle, maneuver, seed)
    return recorded(vehicle, maneuver, flown, seed, noise, name)


def fly(vehicle: Vehicle, maneuver: Maneuver, seed: int = 0) -> Flown:
    """Fly a maneuver from trim, without sensor noise; `seed` is that of the gusts, where the vehicle has some.

    Raises
    ------
    ManeuverError
        A control that the vehicle does not have.
    SimulationError
        No trim, or the flight diverges.
    """
    (flown,) = fly_together([(vehicle, maneuver)], seed)
    if isinstance(flown, SimulationError):
        raise flown
    return flown


def fly_together(
    flights: Sequence[tuple[Vehicle, Maneuver]], seed: int | Sequence[int] = 0
) -> list[Flown | SimulationError]:
    """Fly maneuvers as :func:`fly` does, those on rotors side by side; the errors of those that fail are values.

    `seed` is that of all of them, or one for each.

    Raises
    ------
    ManeuverError
        A control that the vehicle does not have.
    """
    found: dict[int, Flown | SimulationError] = {}
    hovering: dict[int, Departure] = {}
    seeds = np.broadcast_to(seed, len(flights)).tolist()
    for i, (vehicle, maneuver) in enumerate(flights):
        maneuver.check(vehicle)
        try:
            point = maneuver.trim(vehicle)
        except SimulationError as error:
            found[i] = error
            continue
        rng = np.random.default_rng([seeds[i], GUSTS])
        if point.on_wings:
            inputs = point.inputs_about(vehicle, maneuver.deflections(), len(maneuver.time))
            windy = maneuver.wind is not None
            found[i] = _finite(vehicle, _open_loop(vehicle, maneuver.time, inputs, point, rng, windy), ADVICE)
        else:
            hovering[i] = Departure(vehicle, maneuver, point, rng)
    advice = f"raise the rate of the maneuver, {ADVICE}"
    for i, one in zip(hovering, fly_on_rotors([*hovering.values()]), strict=True):
        found[i] = one if isinstance(one, SimulationError) else _finite(flights[i][0], one, advice)
    return [found[i] for i in range(len(flights))]


def _columns(
    vehicle: Vehicle, inputs: Mapping[str, Any] | xr.Dataset | Flight, time: FloatArray | None
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return the time from zero on, and the inputs that the vehicle has."""
    table: Any = inputs.data if isinstance(inputs, Flight) else inputs
    known = (*vehicle.recorded, *vehicle.controls)
    if time is None and "time" not in table:
        raise ManeuverError("inputs: no time is given; add time, seconds at one rate")
    clock = np.asarray(table["time"] if time is None else time, dtype=np.float64)
    steps = np.diff(clock)
    uniform = clock.ndim == 1 and clock.size > 1 and np.allclose(steps, steps[0], rtol=1e-6, atol=0.0)
    if not uniform or not steps[0] > 0.0:
        raise ManeuverError(
            "inputs: the time does not run on at one rate; interpolate the inputs to equal steps"
        )
    has_measurements = isinstance(inputs, Flight) or hasattr(table, "data_vars") or hasattr(table, "columns")
    columns = {}
    for key in table:
        if key == "time" or (has_measurements and key not in known):
            continue
        if key not in known:
            raise ManeuverError(f"inputs: {vehicle.where} has no input '{key}'; {nearest(str(key), known)}")
        columns[str(key)] = np.asarray(table[key], dtype=np.float64)
        if columns[str(key)].shape != clock.shape or not np.isfinite(columns[str(key)]).all():
            raise ManeuverError(
                f"inputs: '{key}' is not finite, or not as long as the time ({clock.size} samples)"
            )
    return np.arange(clock.size, dtype=np.float64) * float(steps.mean()), columns


def _finite(vehicle: Vehicle, flown: Flown, advice: str) -> Flown | SimulationError:
    """Return a flight, or the error of one that diverges."""
    finite = np.isfinite(flown.outputs).all(axis=1)
    if finite.all():
        return flown
    last = flown.time[int(np.argmin(finite))]
    return SimulationError(f"{vehicle.where}: the flight diverges at {last:.2f} s; {advice}")


def _open_loop(
    vehicle: Vehicle, time: FloatArray, inputs: FloatArray, point: Trim, rng: np.random.Generator, windy: bool
) -> Flown:
    """Fly recorded channels (n, n_u) from a trim; with wind, or where it is observed, give the velocity over ground."""
    dt, rows = float(time[1] - time[0]), vehicle.parameter_rows(point.changes)
    start = vehicle.initial_states({**point.start, **vehicle.gust_start(rng)}, rows, inputs[0])
    noise = trajectories.gust_noise(vehicle, len(time), dt, rng)

    def states() -> FloatArray:
        fine, steps = trajectories.arriving(vehicle, rows, inputs, dt, noise)
        return vehicle.states_along(rows, start, fine, dt / steps)[::steps]

    # height above the ground is an input that follows from the states
    if (effect := vehicle.file.ground_effect) is not None:
        column, h = vehicle.inputs.index(effect.channel), vehicle.states.index("h")
        terrain = inputs[:, column] - start[h, 0]
        for _ in range(HEIGHT_PASSES):
            height = states()[:, h] + terrain
            change = float(np.max(np.abs(height - inputs[:, column])))
            inputs[:, column] = height
            if not change > HEIGHT_TOLERANCE:
                break
    fine, steps = trajectories.arriving(vehicle, rows, inputs, dt, noise)
    readings = np.ascontiguousarray(vehicle.kernel().trajectories(rows, start, fine, dt / steps)[:, ::steps])
    velocity = None
    if windy or WIND[0] in vehicle.outputs:
        velocity = point.over_ground(vehicle, states())
    return Flown(point, time, inputs, vehicle.late_outputs(readings, rows, dt)[0], velocity)


def recorded(vehicle: Vehicle, maneuver: Maneuver, flown: Flown, seed: int, noise: bool, name: str) -> Flight:
    """Return a flight as of :func:`simulate_flight`."""
    known = dict.fromkeys((*vehicle.outputs, *(WIND if maneuver.wind is not None else ())))
    unknown = set(maneuver.noise) - set(known)
    if unknown:
        raise ManeuverError(f"noise: '{min(unknown)}' is not observed; channels are {', '.join(known)}")
    sensors = vehicle.file.sensors
    sigma = np.array([maneuver.noise.get(c, getattr(sensors, c).sigma) for c in vehicle.outputs])
    ground_noise = maneuver.noise if noise else None
    return _record(vehicle, flown, sigma * float(noise), maneuver.altitude, seed, name, ground_noise)


def _record(
    vehicle: Vehicle,
    flown: Flown,
    sigma: FloatArray,
    altitude: float,
    seed: int,
    name: str,
    ground_noise: Mapping[str, float] | None,
) -> Flight:
    """Return the flight as recorded by instruments with noise `sigma` (n_y,), from an altitude, m.

    `ground_noise` is that of velocities over ground that are no outputs, m/s, if not the usual one; None for no noise.
    """
    readings = flown.outputs + sigma * np.random.default_rng(seed).standard_normal(flown.outputs.shape)
    columns = dict(zip(vehicle.outputs, readings.T, strict=True))
    columns |= {c: flown.inputs[:, i] for i, c in enumerate(vehicle.recorded)}
    rows = np.repeat(vehicle.parameter_rows(flown.trim.changes), len(flown.inputs), axis=1)
    for control in (c for c in vehicle.controls if c in VARIABLES and c not in vehicle.inputs):
        columns[control] = np.array(vehicle.commanded(control, rows, flown.inputs.T))
    dt = float(flown.time[1] - flown.time[0])
    if flown.velocity is None:
        # The climb rate that the noise-free readings imply, integrated; gusts count as if the aircraft climbed.
        y = dict.fromkeys(CHANNELS, np.zeros(len(flown.time)))
        y |= dict(zip(vehicle.outputs, flown.outputs.T, strict=True))
        body = rigid_states({c: y[c] for c in ("V", "alpha", "beta")})
        down = body["v"] * np.sin(y["phi"]) + body["w"] * np.cos(y["phi"])
        climb = body["u"] * np.sin(y["theta"]) - np.cos(y["theta"]) * down
        steps = 0.5 * (climb[1:] + climb[:-1]) / (1.0 / dt)
        columns["altitude"] = altitude + np.concatenate([[0.0], np.cumsum(steps)])
    else:
        position = traveled(flown.velocity, dt)
        columns = dict(zip(("pn", "pe", "pd"), position.T, strict=True)) | columns
        columns["altitude"] = altitude - position[:, 2]
        draw = np.random.default_rng([seed, _VELOCITY]).standard_normal(flown.velocity.shape)
        for i, channel in enumerate(WIND):
            if channel not in vehicle.outputs:
                noise = 0.0 if ground_noise is None else ground_noise.get(channel, GROUND_SPEED_NOISE)
                columns[channel] = flown.velocity[:, i] + noise * draw[:, i]
    # A fit with the file's own number would put the difference to the trim into the drag.
    notices = [notice("simulated", name)]
    for number, value in flown.trim.numbers_set(vehicle).items():
        unit = vehicle.parameters[vehicle.rows[number]].unit
        given, airspeed = vehicle.value(number), flown.trim.start["V"]
        notices.append(notice("set-by-trim", number, value=value, unit=unit, airspeed=airspeed, given=given))
    if flown.clipped is not None and flown.clipped.any():
        shares = dict(zip(vehicle.rotor_range.names, flown.clipped.mean(axis=0).tolist(), strict=True))
        saturated = tuple(channel for channel, share in shares.items() if share > 0.0)
        notices.append(notice("rotors-saturated", rotors=saturated, share=max(shares.values())))
    numbers = {p.name: flown.trim.changes.get(p.name, p.value) for p in vehicle.parameters if p.free}
    truth = {"truth": json.dumps(numbers)}
    return from_columns(name, flown.time, columns, tuple(notices), attributes=truth)
