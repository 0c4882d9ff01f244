"""What a case of coverage flies: a truth, a start that is wrong, and maneuvers whose noise a seed draws."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.flight import Flight
from stoop.problem.windows import Window
from stoop.simulate import Maneuver, trim
from stoop.vehicle import Parameter, Vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop_studies.verify.steps import maneuver

AIRCRAFT: Final = "twin-boom"  #: built in
DURATION: Final = 15.0  #: s, of each maneuver
RATE: Final = 50.0  #: Hz
WRONG: Final = 0.3  #: starting values are off by up to this share
TRUTHS: Final = {"CLV": 0.05, "CDV": 0.02, "CDalpha2": 1.2, "CmV": 0.03}  #: zero in the built-in vehicle
BIASES: Final = {
    "p": 0.01, "q": 0.01, "r": 0.01, "ax": 0.1, "ay": 0.1, "az": 0.1, "alpha": 0.01, "beta": 0.01,
}  #: SI; standard deviation of each maneuver's biases, and their prior  # fmt: skip
STEPS: Final = {
    "pitch": (("elevator", "3-2-1-1", 1.0, 0.3, 0.12), ("elevator", "doublet", 6.0, 1.5, 0.05)),
    "heave": (("elevator", "doublet", 1.0, 2.5, 0.06), ("elevator", "doublet", 8.0, 0.4, 0.10)),
    "roll": (("aileron", "doublet", 1.0, 0.5, 0.10), ("rudder", "2-1-1", 4.0, 0.6, 0.12)),
    "yaw": (("rudder", "doublet", 1.0, 0.7, 0.15), ("aileron", "2-1-1", 6.0, 0.5, -0.10)),
}  #: maneuver to its inputs: control, shape, start (s), step (s), amplitude (rad)


@dataclass(frozen=True, eq=False)
class Scene:
    """What is identified.

    Attributes
    ----------
    start : Vehicle
        With wrong values, and what is to be found free.
    flights : mapping of str to Flight
    windows : tuple of Window
    truth : mapping of str to float
        Of the free parameters, SI.
    """

    start: Vehicle
    flights: Mapping[str, Flight]
    windows: tuple[Window, ...]
    truth: Mapping[str, float]


@functools.cache
def maneuvers() -> Mapping[str, Maneuver]:
    """Return the maneuvers by name."""
    return {name: maneuver(steps, DURATION, RATE) for name, steps in STEPS.items()}


@functools.cache
def aircraft() -> Vehicle:
    """Return the truth: the twin-boom aircraft on all six degrees of freedom, none of its 32 coefficients zero."""
    vehicle = resolve_vehicle(AIRCRAFT).with_numbers({n: {"value": v} for n, v in TRUTHS.items()})
    thrust = float(
        trim(vehicle).thrust["propulsion.thrust"]
    )  # as it is flown: what is not free must be right
    return vehicle.with_numbers({"propulsion.thrust": {"value": thrust}})


def coefficients(vehicle: Vehicle) -> dict[str, float]:
    """Return the free numbers without sensor biases, by name."""
    return {p.name: p.value for p in vehicle.parameters if p.free and not p.name.startswith("sensors.")}


def biased(vehicle: Vehicle, rng: np.random.Generator) -> Vehicle:
    """Return a vehicle whose sensors have biases that are drawn from their prior."""
    return vehicle.with_numbers(
        {f"sensors.{c}.bias": {"value": s * rng.standard_normal()} for c, s in BIASES.items()}
    )


def misled(vehicle: Vehicle, rng: np.random.Generator) -> Vehicle:
    """Return a vehicle to start from: coefficients wrong, in boxes that no estimate meets, and biases unknown."""
    wrong = {
        p.name: {"value": p.value * rng.uniform(1.0 - WRONG, 1.0 + WRONG), "bounds": _widened(p)}
        for p in vehicle.parameters
        if p.name in coefficients(vehicle)
    }
    unknown = {f"sensors.{c}.bias": {"value": 0.0, "free": True, "prior": s} for c, s in BIASES.items()}
    return vehicle.with_numbers({**wrong, **unknown})


def _widened(parameter: Parameter) -> tuple[float, float]:
    """Return a box twice as wide as the vehicle file's: a bound that is met has no error bar."""
    more = 0.5 * (parameter.upper - parameter.lower)
    return parameter.lower - more, parameter.upper + more


def windows() -> tuple[Window, ...]:
    """Return all of each maneuver."""
    return tuple(Window(name, 0.0, DURATION) for name in STEPS)


def sensor_noise(vehicle: Vehicle) -> FloatArray:
    """Return the standard deviation (n_y,) of each channel's noise, as the vehicle file says."""
    return np.array([getattr(vehicle.file.sensors, c).sigma for c in vehicle.outputs])
