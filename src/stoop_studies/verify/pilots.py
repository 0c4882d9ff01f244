"""Flights of made-up aircraft under a pilot, by stoop's simulation and by JSBSim: what happened, without instruments.

A pilot holds attitude, height and speed by noisy readings, and lets go in part while a maneuver runs. What is commanded by
the readings of one sample acts at the next, so that surfaces are correlated with gusts and noise as in a real log.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from scipy.optimize import brentq
from scipy.signal import bilinear, lfilter

from stoop.base.arrays import FloatArray
from stoop.base.units import FOOT
from stoop.base.variables import EULER, RATES, VELOCITY
from stoop.simulation import Trim, trim
from stoop.simulation.fly import fly as fly_maneuver
from stoop.simulation.maneuver import Maneuver
from stoop.simulation.trim import traveled
from stoop.vehicle import Vehicle, parse_vehicle, trajectories
from stoop_analysis.known_model import without_turbulence
from stoop_export import jsbsim_aircraft, jsbsim_flight
from stoop_studies.verify.defects import edited
from stoop_studies.verify.scenes import step_maneuvers

RATE: Final = 50.0  #: Hz, of aircraft
ROTOR_RATE: Final = 100.0  #: Hz
DURATION: Final = 84.0  #: s, airborne
ROTOR_DURATION: Final = 60.0  #: s
ALTITUDE: Final = 250.0  #: m
FRAME_RATE: Final = 250.0  #: Hz, of JSBSim's steps
READING_NOISE: Final = {"phi": 0.003, "theta": 0.003, "p": 0.006, "q": 0.006, "r": 0.006, "V": 0.2}
HANDS_OFF: Final = 0.25  #: share of the pilot's gains that is left while a maneuver runs
MAX_PITCH_CHANGE: Final = 0.12  #: rad, by which the height is held
Columns = dict[str, FloatArray]
Law = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class Response:
    """Shape of the response that inputs are sized for, as test plans do (Jategaonkar, chapter 2)."""

    alpha: float = 0.05  #: rad
    beta: float = 0.08  #: rad
    helix: float = 0.04  #: pb/2V
    step: float = 1.9  #: of a 3-2-1-1, times the natural frequency: its center is at 0.3/step Hz
    half_period: float = 0.5  #: of a doublet's step, in periods of the Dutch roll


RESPONSE: Final = Response()


@dataclass(frozen=True, eq=False)
class Plan:
    """What the pilot does: changes of the commands from trim (rad, throttle), and where he holds on (0 to 1)."""

    changes: Mapping[str, FloatArray]
    hold: FloatArray


def natural_frequencies(vehicle: Vehicle) -> tuple[float, float]:
    """Return about the frequencies of short period and Dutch roll, rad/s, by their stiffness alone."""
    v = vehicle.value
    pressure_area = 0.5 * 1.2 * v("reference.airspeed") ** 2 * v("reference.area")
    pitch = -v("Cmalpha") * pressure_area * v("reference.chord") / v("mass.inertia.yy")
    yaw = v("Cnbeta") * pressure_area * v("reference.span") / v("mass.inertia.zz")
    return float(np.sqrt(pitch)), float(np.sqrt(yaw))


def plan(vehicle: Vehicle, throw: Mapping[str, float], rng: np.random.Generator) -> Plan:
    """Draw cruise, maneuvers about all axes, a step of the throttle, cruise, and a second set of maneuvers."""
    short, dutch = natural_frequencies(vehicle)
    v = vehicle.value
    rudder = "rudder" in vehicle.controls
    sizes = {
        "elevator": RESPONSE.alpha * abs(v("Cmalpha") / v("Cmelevator")),
        "aileron": RESPONSE.helix * abs(v("Clp") / v("Claileron")),
        "rudder": RESPONSE.beta * abs(v("Cnbeta") / v("Cnrudder")) if rudder else 0.0,
    }
    pitch = float(np.clip(RESPONSE.step / short, 0.12, 0.6))
    yaw = float(np.clip(RESPONSE.half_period * 2.0 * np.pi / dutch, 0.3, 1.5))
    roll = float(np.clip(4.0 * v("reference.span") / v("reference.airspeed"), 0.4, 0.8))
    second = "rudder" if rudder else "aileron"
    series = (
        ("elevator", "3-2-1-1", 8.0, pitch), (second, "doublet", 17.0, yaw if rudder else 1.5 * roll),
        ("aileron", "1-1", 25.0, roll), ("elevator", "doublet", 32.0, 2.0 * pitch),
        ("elevator", "3-2-1-1", 49.0, 1.15 * pitch), (second, "2-1-1", 57.0, 0.7 * yaw if rudder else roll),
        ("aileron", "2-1-1", 66.0, 0.8 * roll), ("elevator", "doublet", 75.0, 1.5 * pitch),
    )  # fmt: skip
    inputs, hold = [], np.ones(round(DURATION * RATE) + 1)
    time = np.arange(len(hold)) / RATE
    for control, shape, begin, step in series:
        start = begin + rng.uniform(0.0, 1.0)
        size = float(np.clip(sizes[control] * rng.uniform(0.8, 1.3), 0.02, 0.75 * throw[control]))
        inputs.append((control, shape, start, step * rng.uniform(0.9, 1.1), size * rng.choice((-1.0, 1.0))))
        hold[(time > start - 0.3) & (time < start + 8.0 * step + 2.0)] = HANDS_OFF
    maneuver = step_maneuvers({"plan": tuple(inputs)}, DURATION, RATE)["plan"]
    changes = maneuver.deflections()
    if vehicle.file.propulsion is not None:
        start, size = 40.0 + rng.uniform(0.0, 1.0), rng.uniform(0.15, 0.3) * rng.choice((-1.0, 1.0))
        changes["control_throttle"] = np.where((time > start) & (time < start + 4.0), size, 0.0)
    return Plan(changes, hold)


def pilot_law(vehicle: Vehicle) -> Law:
    """Return rad of a surface (throttle) per rad, rad/s or m/s of a reading above its trim."""
    v = vehicle.value
    pitch = 0.6 * abs(v("Cmalpha") / v("Cmelevator"))
    roll = 0.8 * v("reference.span") / (2.0 * v("reference.airspeed")) * abs(v("Clp") / v("Claileron"))
    law = {"elevator": {"theta": pitch, "q": 0.1 * pitch}, "aileron": {"phi": -roll, "p": -0.05 * roll}}
    return law if vehicle.file.propulsion is None else {**law, "control_throttle": {"V": -0.04}}


class Pilot:
    """Commands (n, n_u) in the order of the vehicle's inputs, filled sample by sample; a radio sends every `every`-th."""

    def __init__(
        self,
        vehicle: Vehicle,
        point: Trim,
        planned: Plan,
        throw: Mapping[str, float],
        rng: np.random.Generator,
        every: int = 1,
    ) -> None:
        count, self.every = len(planned.hold), every
        self.names = vehicle.inputs
        self.inputs = np.repeat(point.inputs[None], count, axis=0)
        for name, change in planned.changes.items():
            self.inputs[:, self.names.index(name)] += change
        self.law, self.hold, self.start = pilot_law(vehicle), planned.hold, point.start
        self.limits = {c: (-throw.get(c, 1.0), throw.get(c, 1.0)) for c in self.law} | {
            "control_throttle": (0.0, 1.0)
        }
        self.noise = {c: s * rng.standard_normal(count) for c, s in READING_NOISE.items()}
        self.powered = vehicle.file.propulsion is not None

    def command(self, k: int, now: Mapping[str, float], altitude: float) -> None:
        """Set the commands of sample k + 1 by the readings of sample k, or hold those that the radio sent last."""
        if (k + 1) % self.every:
            self.inputs[k + 1] = self.inputs[k]
            return
        high = altitude - self.start["h"] if self.powered else 0.0
        wanted = {"theta": float(np.clip(-0.01 * high, -MAX_PITCH_CHANGE, MAX_PITCH_CHANGE))}
        for control, gains in self.law.items():
            i = self.names.index(control)
            for reading, gain in gains.items():
                level = self.start.get(reading, 0.0) + wanted.get(reading, 0.0)
                error = now[reading] + self.noise[reading][k] - level
                self.inputs[k + 1, i] += self.hold[k] * gain * error
            self.inputs[k + 1, i] = np.clip(self.inputs[k + 1, i], *self.limits[control])


def steady(vehicle: Vehicle) -> Trim:
    """Return level flight at V*, or the glide of an aircraft without an engine: where a thrust that held it would be zero."""
    if vehicle.file.propulsion is not None:
        return trim(vehicle, None, ALTITUDE)
    powered = parse_vehicle(
        edited(vehicle.text, {"propulsion": {"kind": "constant", "thrust": 0.0}}), "glide"
    )

    def thrust(angle: float) -> float:
        return float(trim(powered, None, ALTITUDE, angle).thrust["propulsion.thrust"])

    point = trim(powered, None, ALTITUDE, float(brentq(thrust, -0.3, 0.0, xtol=1e-9)))
    return replace(point, thrust={}, changes={}, inputs=point.inputs[: len(vehicle.inputs)])


def by_stoop(
    vehicle: Vehicle, planned: Plan, throw: Mapping[str, float], rng: np.random.Generator, every: int = 1
) -> Columns:
    """Fly an aircraft by stoop's simulation, through the gusts of its file; a radio sends every `every`-th command."""
    point, count, dt = steady(vehicle), len(planned.hold), 1.0 / RATE
    pilot = Pilot(vehicle, point, planned, throw, rng, every)
    rows = vehicle.parameter_rows(point.changes)
    gusts = trajectories.gust_noise(vehicle, count, dt, rng)
    states = np.empty((count, len(vehicle.states)))
    begin = {**point.start, **vehicle.gust_start(rng)}
    states[0] = vehicle.initial_states(begin, rows, pilot.inputs[0])[:, 0]
    height = vehicle.states.index("h")
    for k in range(count - 1):
        read = vehicle.readings_along(rows, states[k : k + 1], pilot.inputs[k : k + 1])[0]
        pilot.command(k, dict(zip(vehicle.outputs, read.tolist(), strict=True)), float(states[k, height]))
        noise = gusts[trajectories.FINER * k : trajectories.FINER * (k + 1) + 1]
        states[k + 1] = vehicle.next_states(
            rows, states[k][:, None], pilot.inputs[k : k + 2][:, :, None], [noise], dt
        )[:, 0]
    readings = vehicle.readings_along(rows, states, pilot.inputs)
    columns = dict(zip(vehicle.outputs, readings.T, strict=True))
    columns |= dict(zip(VELOCITY, point.over_ground(vehicle, states).T, strict=True))
    return {**columns, "altitude": states[:, height], **_inputs(pilot)}


def _inputs(pilot: Pilot) -> Columns:
    return {n: x for n, x in zip(pilot.names, pilot.inputs.T, strict=True) if n != "none"}


def by_jsbsim(
    vehicle: Vehicle, planned: Plan, throw: Mapping[str, float], rng: np.random.Generator
) -> Columns:
    """Fly the exported aircraft by JSBSim over its own Earth, through gusts that pass as those of the file do."""
    calm, _ = without_turbulence(vehicle)
    point, count = steady(calm), len(planned.hold)
    pilot = Pilot(calm, point, planned, throw, rng)
    time = np.arange(count) / RATE
    record = jsbsim_flight.Record(calm, point.start, time, pilot.inputs)
    with tempfile.TemporaryDirectory(prefix="stoop-fleet-") as folder:
        root, name = Path(folder), jsbsim_flight.file_name(calm.name)
        for place, text in jsbsim_aircraft.folder(calm, None).items():
            (root / place).parent.mkdir(parents=True, exist_ok=True)
            (root / place).write_text(text, encoding="utf-8")
        simulation = jsbsim_flight.begin(root, name, record, None, jsbsim_flight.Host(FRAME_RATE))
        gusts = dryden(vehicle, count, rng)
        rows = []
        for k in range(count):
            rows.append(_sample(simulation))
            if k + 1 < count:
                pilot.command(k, rows[-1], rows[-1]["altitude"])
                for axis, speed in zip(("north", "east", "down"), gusts[k].tolist(), strict=True):
                    simulation.fdm[f"atmosphere/gust-{axis}-fps"] = speed / FOOT
                simulation.advance(pilot.inputs[k], pilot.inputs[k + 1])
    columns = {n: np.array([row[n] for row in rows]) for n in rows[0]}
    return {**columns, **_inputs(pilot)}


def dryden(vehicle: Vehicle, count: int, rng: np.random.Generator) -> FloatArray:
    """Return gusts (n, 3) along north, east and down, m/s, by the spectra of the vehicle's file, flying north at V*.

    The filters of MIL-F-8785C: first order along the flight, second order across, driven by white noise.
    """
    out = np.zeros((count, 3))
    if vehicle.file.turbulence is None:
        return out
    speed, ahead = vehicle.value("reference.airspeed"), 1000
    for i, axis in enumerate("uvw"):
        length, intensity = (vehicle.value(f"turbulence.{axis}.{n}") for n in ("length", "intensity"))
        tau = length / speed
        along = ([1.0], [tau, 1.0])
        across = ([np.sqrt(3.0) * tau, 1.0], [tau**2, 2.0 * tau, 1.0])
        above, below = along if axis == "u" else across
        numerator, denominator = bilinear(above, below, fs=RATE)
        driven = lfilter(numerator, denominator, rng.standard_normal(count + ahead))[ahead:]
        long = lfilter(numerator, denominator, np.r_[1.0, np.zeros(20 * round(tau * RATE) + 20)])
        out[:, i] = intensity * driven / np.sqrt(np.sum(long**2))
    return out


def _sample(simulation: jsbsim_flight.Simulation) -> dict[str, float]:
    """Return what stands in JSBSim: the readings at the center of gravity."""
    s = simulation.read()
    u, v, w = s["u"], s["v"], s["w"]
    speed = float(np.sqrt(u * u + v * v + w * w))
    ground = (float(simulation.fdm[f"velocities/v-{a}-fps"]) * FOOT for a in ("north", "east", "down"))
    return {
        "V": speed, "alpha": float(np.arctan2(w, u)), "beta": float(np.arcsin(v / speed)),
        **{n: s[n] for n in (*RATES, *EULER)}, **{f"a{a.lower()}": s[a] / s["mass"] for a in "XYZ"},
        **dict(zip(VELOCITY, ground, strict=True)), "altitude": s["h"],
    }  # fmt: skip


def on_rotors(vehicle: Vehicle, wind: FloatArray, rng: np.random.Generator) -> Columns:
    """Fly a multirotor by stoop's simulation and autopilot: hover, shakes about all axes and velocities, twice.

    The ``wind`` (2,) blows north and east, m/s.
    """
    shakes = []
    for leg in range(2):
        for begin, control, shape, step, size in (
            (4.0, "roll", "3-2-1-1", 0.15, 10.0), (7.0, "pitch", "3-2-1-1", 0.15, 10.0),
            (10.0, "yaw", "3-2-1-1", 0.3, 1.5), (13.0, "heave", "3-2-1-1", 0.3, 2.5),
            (16.0, "north", "doublet", 2.0, 4.0), (21.0, "east", "doublet", 2.0, 3.0),
        ):  # fmt: skip
            start = 30.0 * leg + begin + rng.uniform(0.0, 0.5)
            sign = float(rng.choice((-1.0, 1.0)))
            shakes.append(
                (control, shape, start, step * rng.uniform(0.9, 1.1), sign * size * rng.uniform(0.8, 1.2))
            )
    maneuver: Maneuver = step_maneuvers({"plan": tuple(shakes)}, ROTOR_DURATION, ROTOR_RATE)["plan"]
    blown = maneuver.model_copy(update={"altitude": ALTITUDE, "wind": (*wind.tolist(), 0.0)})
    flown = fly_maneuver(vehicle, blown, int(rng.integers(2**31)))
    columns = dict(zip(vehicle.outputs, flown.outputs.T, strict=True))
    if flown.velocity is not None:
        columns |= dict(zip(VELOCITY, flown.velocity.T, strict=True))
        columns["altitude"] = ALTITUDE - traveled(flown.velocity, 1.0 / ROTOR_RATE)[:, 2]
    return {**columns, **{c: flown.inputs[:, i] for i, c in enumerate(vehicle.recorded)}}


FLYING: Final[Mapping[str, Callable[..., Columns]]] = {"stoop": by_stoop, "JSBSim": by_jsbsim}
