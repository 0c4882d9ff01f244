"""Simulated flights under an autopilot, through gusts of MIL-F-8785C: an aircraft and a quadrotor.

The aircraft holds attitude by its surfaces, and the maneuvers of `scenes` are added to the commands. A command is computed from
the noisy readings of one sample and acts at the next, so that recorded surfaces are correlated with gusts and with sensor
noise. The quadrotor is flown by the autopilot of `stoop simulate`. The vehicle files that the fits begin with know of no gusts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.flight import Flight, from_columns
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.simulation.steady_flight import trim
from stoop.vehicle import Vehicle, trajectories
from stoop.vehicle.builtin import load_vehicle
from stoop_studies.verify import scenes

Law = Mapping[str, Mapping[str, float]]
LAW: Final[Law] = {
    "elevator": {"theta": 0.5, "q": 0.2},
    "aileron": {"phi": -0.6, "p": -0.15},
    "rudder": {"r": 0.3},
}  #: rad of a surface per rad or rad/s of a reading above its trim
#: coefficients that make the aircraft unstable, and the surface that then has other gains; modes that double within half a
#: second and are held by the autopilot
UNSTABLE: Final[Mapping[str, tuple[Mapping[str, float], Law]]] = {
    "pitch": ({"Cmalpha": 1.5}, {**LAW, "elevator": {"theta": 1.5, "q": 0.5}}),
    "yaw": ({"Cnbeta": -0.085}, {**LAW, "rudder": {"r": 1.0, "beta": -1.0}}),
}
QUADROTOR: Final = "quad-x"  #: built in
LEGS: Final = 4  #: each `LEG` s with the inputs of `LEG_STEPS`
LEG: Final = 10.0
QUADROTOR_RATE: Final = 100.0  #: Hz
WIND: Final = (2.0, -1.0, 0.0)  #: m/s north, east, down: steady
PASSING: Final = 5.0  #: m/s, at which gusts pass the quadrotor
LEG_STEPS: Final[tuple[scenes.Step, ...]] = (
    ("roll", "doublet", 1.0, 0.15, 8.0), ("pitch", "doublet", 2.0, 0.15, 8.0), ("yaw", "doublet", 3.0, 0.4, 1.5),
    ("heave", "3-2-1-1", 4.0, 0.25, 2.0), ("north", "doublet", 4.5, 2.0, 2.5), ("east", "doublet", 5.0, 2.0, 2.5),
    ("down", "doublet", 5.5, 2.0, 1.0), ("heading", "doublet", 6.0, 1.5, 0.6),
)  #: rad/s2, m/s2, m/s, rad  # fmt: skip
QUADROTOR_ERROR: Final = 0.2  #: starting values are off by up to this share
INERTIA: Final = tuple(f"mass.inertia.{axis}" for axis in ("xx", "yy", "zz"))


def gain_matrix(vehicle: Vehicle, law: Law) -> FloatArray:
    """Return surfaces (n_u, n_y) per reading of a law."""
    gains = np.zeros((len(vehicle.inputs), len(vehicle.outputs)))
    for surface, readings in law.items():
        for channel, gain in readings.items():
            gains[vehicle.inputs.index(surface), vehicle.outputs.index(channel)] = gain
    return gains


def fly(vehicle: Vehicle, maneuver: Maneuver, rng: np.random.Generator, name: str, law: Law = LAW) -> Flight:
    """Fly a maneuver from trim under the autopilot, as instruments with the noise of the vehicle file record it."""
    count, dt = len(maneuver.time), 1.0 / maneuver.rate
    point = trim(vehicle, None, scenes.ALTITUDE)
    inputs = point.inputs_about(vehicle, maneuver.deflections(), count)
    rows, gains = vehicle.parameter_rows(point.changes), gain_matrix(vehicle, law)
    start = {**point.start, **vehicle.gust_start(rng)}
    gusts = trajectories.gust_noise(vehicle, count, dt, rng)
    errors = scenes.sensor_noise(vehicle) * rng.standard_normal((count, len(vehicle.outputs)))
    level = np.array([point.start.get(c, 0.0) for c in vehicle.outputs])
    states = np.empty((count, len(vehicle.states)))
    states[0] = vehicle.initial_states(start, rows, inputs[0])[:, 0]
    for k in range(count - 1):
        read = vehicle.readings_along(rows, states[k : k + 1], inputs[k : k + 1])[0]
        inputs[k + 1] += gains @ (read + errors[k] - level)
        noise = gusts[trajectories.FINER * k : trajectories.FINER * (k + 1) + 1]
        states[k + 1] = vehicle.next_states(
            rows, states[k][:, None], inputs[k : k + 2][:, :, None], [noise], dt
        )[:, 0]
    readings = vehicle.readings_along(rows, states, inputs) + errors
    columns = dict(zip(vehicle.outputs, readings.T, strict=True))
    columns |= {c: inputs[:, i] for i, c in enumerate(vehicle.recorded)}
    columns["altitude"] = states[:, vehicle.states.index("h")]
    return from_columns(name, maneuver.time, columns)


def aircraft_scene(wind: float, seed: int, unstable: str = "") -> scenes.Scene:
    """Return maneuvers of the aircraft under the autopilot, in the turbulence of a wind at 20 ft, m/s.

    It is unstable about an axis of `UNSTABLE`, or as it is built in.
    """
    rng = np.random.default_rng(seed)
    changes, law = UNSTABLE[unstable] if unstable else ({}, LAW)
    aircraft = scenes.with_trim_thrust(
        scenes.aircraft().with_numbers({n: {"value": v} for n, v in changes.items()})
    )
    truth = scenes.in_turbulence(aircraft, wind) if wind else aircraft
    flights = {
        name: fly(scenes.with_biases(truth, rng), maneuver, rng, name, law)
        for name, maneuver in scenes.maneuvers().items()
    }
    start = scenes.wrong_start(aircraft, rng)
    return scenes.Scene(start, flights, scenes.whole_maneuvers(), scenes.coefficients(aircraft))


def lateral_scene(wind: float, seed: int) -> scenes.Scene:
    """Return maneuvers of the aircraft as :func:`aircraft_scene`, to be identified by its lateral model."""
    scene = aircraft_scene(wind, seed)
    start = scene.start.reduced("lateral")
    free = {p.name for p in start.parameters if p.free}
    return replace(scene, start=start, truth={n: v for n, v in scene.truth.items() if n in free})


def quadrotor_scene(wind: float, seed: int) -> scenes.Scene:
    """Return a flight of the quadrotor, its mass known and its inertia free, in the turbulence of a wind at 20 ft, m/s."""
    calm, rng = load_vehicle(QUADROTOR), np.random.default_rng(seed)
    steps = tuple(
        (control, shape, LEG * leg + start, step, amplitude * (-1.0) ** (leg * (control == "north")))
        for leg in range(LEGS)
        for control, shape, start, step, amplitude in LEG_STEPS
    )
    maneuver = scenes.step_maneuvers({QUADROTOR: steps}, LEGS * LEG, QUADROTOR_RATE)[QUADROTOR]
    maneuver = maneuver.model_copy(update={"wind": WIND})
    blown = scenes.in_turbulence(calm, wind, PASSING) if wind else calm
    flight = simulate_flight(blown, maneuver, seed=int(rng.integers(2**31)), name=QUADROTOR)
    truth = scenes.coefficients(calm) | {name: calm.value(name) for name in INERTIA}
    low, high = 1.0 - QUADROTOR_ERROR, 1.0 + QUADROTOR_ERROR
    changes = {n: {"free": True, "value": v * rng.uniform(low, high)} for n, v in truth.items()}
    xx, yy, zz = (changes[n] for n in INERTIA)
    zz["value"] = min(zz["value"], xx["value"] + yy["value"])  # of a body: no other file loads
    bounds = {n: {"bounds": (v / 3.0, 3.0 * v)} for n, v in truth.items() if n in INERTIA}
    start = calm.with_numbers({n: change | bounds.get(n, {}) for n, change in changes.items()})
    return scenes.Scene(start, {QUADROTOR: flight}, (Window(QUADROTOR, 0.0, LEGS * LEG),), truth)
