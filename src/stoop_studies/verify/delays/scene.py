"""Flights whose delays are known: simulated twenty times as fast as they are recorded, delays whole steps of that.

So no interpolation of the estimator's kind is in the data: a delay of 0.35 sample is exactly seven steps.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import tomlkit

from stoop.base.arrays import FloatArray
from stoop.base.rotations import matrices_of, quaternions_of
from stoop.base.variables import EULER
from stoop.flight import Flight, from_columns
from stoop.problem.windows import Window
from stoop.simulate import Maneuver, simulate_flight, trim
from stoop.simulate.initial import rigid_states
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop.vehicle.load import parse_vehicle
from stoop_studies.verify.coverage.scene import BIASES, TRUTHS, Scene, biased, misled
from stoop_studies.verify.steps import maneuver

RATE: Final = 100.0  #: Hz, as recorded
STEPS_EACH: Final = 20  #: of the simulation between two samples
FINE: Final = RATE * STEPS_EACH
DURATION: Final = 15.0  #: s, of each maneuver
SLEW: Final = 1.0  #: rad/s: what moves between samples must be seen in them
BOX: Final = (-0.05, 0.15)  #: s, in which delays are looked for
START: Final = 0.02  #: s
MOST: Final = 100  #: steps; the longest delay drawn, five samples
LONG: Final = 300  #: steps; of velocity and position, as a receiver delivers them
INPUTS: Final = ("elevator", "aileron", "rudder")
SENSORS: Final = ("V", "alpha", "beta", "phi", "theta", "psi")
NOISE: Final = {
    "V": 0.02, "alpha": 0.001, "beta": 0.001, "p": 0.002, "q": 0.002, "r": 0.002, "phi": 0.0005, "theta": 0.0005,
    "psi": 0.0005, "ax": 0.03, "ay": 0.03, "az": 0.03, "vn": 0.03, "ve": 0.03, "vd": 0.03, "pn": 0.1, "pe": 0.1, "pd": 0.1,
}  #: SI, white  # fmt: skip
STEPS: Final = {
    "pitch": (("elevator", "3-2-1-1", 1.0, 0.3, 0.12), ("elevator", "doublet", 6.0, 2.0, 0.12)),
    "heave": (("elevator", "doublet", 1.0, 2.5, 0.12), ("elevator", "doublet", 8.0, 0.5, 0.12)),
    "roll": (("aileron", "doublet", 1.0, 0.5, 0.10), ("rudder", "2-1-1", 4.0, 0.6, 0.12)),
    "yaw": (("rudder", "doublet", 1.0, 0.7, 0.15), ("aileron", "2-1-1", 6.0, 0.5, -0.10)),
}  #: maneuver to its inputs: control, shape, start (s), step (s), amplitude (rad)
WIND: Final = (3.0, -2.0, 0.0)  #: m/s
GROUPS: Final = {
    "rates": ("p", "q", "r"), "attitude": ("phi", "theta", "psi"), "V": ("V",), "alpha": ("alpha",), "beta": ("beta",),
    "velocity": ("vn", "ve", "vd"), "position": ("pn", "pe", "pd"),
}  #: sensors of a compatibility check that are late together  # fmt: skip


@functools.cache
def maneuvers() -> Mapping[str, Maneuver]:
    """Return the maneuvers by name, at the rate of the simulation."""
    return {name: maneuver(steps, DURATION, FINE, slew=SLEW) for name, steps in STEPS.items()}


@functools.cache
def aircraft() -> Vehicle:
    """Return the twin-boom aircraft with a delay on every control and on every sensor but the inertial ones."""
    plain = resolve_vehicle("twin-boom")
    document: Any = tomlkit.parse(plain.text)
    unknown = {"value": 0.0, "free": True, "bounds": list(BOX)}
    for table, names in (("controls", INPUTS), ("sensors", SENSORS)):
        for name in names:
            document.setdefault(table, {}).setdefault(name, {})["delay"] = dict(unknown)
    vehicle = parse_vehicle(tomlkit.dumps(document), plain.where)
    vehicle = vehicle.with_numbers({name: {"value": value} for name, value in TRUTHS.items()})
    return vehicle.with_numbers(
        {"propulsion.thrust": {"value": float(trim(vehicle).thrust["propulsion.thrust"])}}
    )


def delay_names() -> tuple[str, ...]:
    """Return the delays that are drawn and looked for in an identification."""
    return (*(f"controls.{c}.delay" for c in INPUTS), *(f"sensors.{c}.delay" for c in SENSORS))


def late_vehicle(seed: int) -> Scene:
    """Return an identification in which nine delays are unknown beside 32 coefficients."""
    rng = np.random.default_rng(seed)
    delays = {name: int(rng.integers(0, MOST + 1)) / FINE for name in delay_names()}
    truth = aircraft().with_numbers({name: {"value": value} for name, value in delays.items()})
    flights = {}
    for name, planned in maneuvers().items():
        flown = simulate_flight(biased(truth, rng), planned, noise=False, name=name)
        flights[name] = recorded(
            name, flown.time, {str(c): flown.column(str(c)) for c in flown.data.data_vars}, rng
        )
    wrong = misled(aircraft(), rng)
    start = wrong.with_numbers({name: {"value": START, "bounds": BOX} for name in delays})
    return Scene(start, flights, tuple(Window(name, 0.0, DURATION) for name in STEPS), delays)


def late_sensors(seed: int) -> tuple[Flight, dict[str, float]]:
    """Return a flight for a compatibility check, and the delay of each group of sensors, s."""
    rng = np.random.default_rng(seed)
    steps = {
        name: int(rng.integers(0, (LONG if name in ("velocity", "position") else MOST) + 1))
        for name in GROUPS
    }
    still = aircraft().with_numbers({name: {"value": 0.0} for name in delay_names()})
    flown = [simulate_flight(still, maneuver, noise=False) for maneuver in maneuvers().values()]
    biases = {c: sigma * rng.standard_normal() for c, sigma in BIASES.items()}
    true = [_moved({c: f.column(c) for c in still.outputs}) for f in flown]
    parts = [{c: x + biases.get(c, 0.0) for c, x in part.items()} for part in true]
    late = [{c: _shifted(c, x, steps) for c, x in part.items()} for part in parts]
    gap = np.full(int(FINE), np.nan)  # a second in which nothing was logged keeps the maneuvers apart
    whole = {c: np.concatenate([x for part in late for x in (part[c], gap)]) for c in late[0]}
    time = np.arange(len(whole["V"])) / FINE
    return recorded(f"late {seed}", time, whole, rng), {n: k / FINE for n, k in steps.items()}


def _moved(columns: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Add velocity over ground and position to what a vehicle's sensors read."""
    body = rigid_states({name: columns[name] for name in ("V", "alpha", "beta")})
    rotation = matrices_of(quaternions_of(np.column_stack([columns[name] for name in EULER])))
    air = np.column_stack([body[name] for name in "uvw"])
    ground = np.einsum("nij,nj->ni", rotation, air) + np.array(WIND)
    place = np.concatenate([np.zeros((1, 3)), np.cumsum(0.5 * (ground[1:] + ground[:-1]), axis=0) / FINE])
    moved = dict(zip(("vn", "ve", "vd"), ground.T, strict=True)) | dict(
        zip(("pn", "pe", "pd"), place.T, strict=True)
    )
    return {**columns, **moved}


def _shifted(channel: str, x: FloatArray, steps: Mapping[str, int]) -> FloatArray:
    late = next((steps[name] for name, channels in GROUPS.items() if channel in channels), 0)
    return np.concatenate([np.full(late, x[0]), x[: len(x) - late]])


def recorded(
    name: str, time: FloatArray, columns: Mapping[str, FloatArray], rng: np.random.Generator
) -> Flight:
    """Take every twentieth sample, with noise."""
    kept = {c: x[::STEPS_EACH] for c, x in columns.items() if c not in ("q0", "q1", "q2", "q3")}
    noisy = {c: x + NOISE.get(c, 0.0) * rng.standard_normal(len(x)) for c, x in kept.items()}
    return from_columns(name, time[::STEPS_EACH], noisy)
