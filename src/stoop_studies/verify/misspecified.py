"""Coverage of 95 % intervals on flights whose truth has terms, gusts and sensor defects that the fitted model lacks."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.units import DEGREE
from stoop.estimate import methods
from stoop.estimate.fit import Fit, Options
from stoop.flight import Flight
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop.vehicle.load import parse_vehicle
from stoop_studies.verify import scenes

AXES: Final[tuple[scenes.Step, ...]] = (
    ("elevator", "3-2-1-1", 1.0, 0.3, 0.08),
    ("rudder", "doublet", 5.0, 0.6, 0.08),
    ("aileron", "2-1-1", 9.0, 0.5, 0.06),
)  #: inputs of each maneuver, before what a seed draws
DELAY: Final = 2.0  #: s; by up to which an input comes later
STRETCH: Final = (0.6, 1.6)  #: range of the factors on step and amplitude
DEFLECTION_NOISE: Final = 0.05 * DEGREE  #: rad, white, on what is recorded of each control
VANE_SCALE: Final = 1.08  #: of the flow angles as the vanes read them
SERVO_LAG: Final = 0.04  #: s, first order, of all controls
TERMS: Final = {
    "CL": {"CLalpha2": ("alpha^2", -6.0)},
    "Cm": {"Cmalpha2": ("alpha^2", -1.5), "Cmbeta2": ("beta^2", 0.5)},
    "CQ": {"CQalphabeta": ("alpha*beta", -1.0)},
    "Cl": {"Clalphabeta": ("alpha*beta", -0.3), "Clalphar": ("alpha*r", 0.8), "Clalphap": ("alpha*p", 1.5)},
    "Cn": {"Cnalphabeta": ("alpha*beta", 0.25), "Cnalphap": ("alpha*p", -0.6), "Cnbeta3": ("beta^3", 1.0)},
}  #: coefficient to terms that the truth has and the model lacks


def drawn_maneuver(rng: np.random.Generator) -> Maneuver:
    """Return a maneuver of the population: an input on each axis, with times, steps, signs and amplitudes drawn."""
    inputs = []
    for control, shape, start, step, amplitude in AXES:
        stretch = rng.uniform(*STRETCH, size=2)
        inputs.append(
            {
                "control": control, "shape": shape, "start": start + rng.uniform(0.0, DELAY), "step": step * stretch[0],
                "amplitude": amplitude * stretch[1] * rng.choice((-1.0, 1.0)),
            }
        )  # fmt: skip
    return Maneuver.model_validate({"duration": scenes.DURATION, "rate": scenes.RATE, "input": inputs})


@functools.cache
def richer_aircraft() -> Vehicle:
    """Return the aircraft with terms that the fitted model lacks."""
    text = scenes.aircraft().text
    for coefficient, terms in TERMS.items():
        head = f"[aerodynamics.{coefficient}]\n"
        lines = [
            f'{name} = {{ term = "{term}", value = {value} }}\n' for name, (term, value) in terms.items()
        ]
        text = text.replace(head, head + "".join(lines))
    return _as_scenes_has_it(text, "twin-boom with further terms")


@functools.cache
def slower_aircraft() -> Vehicle:
    """Return the aircraft with a lag of its servos, and vanes of a wrong scale."""
    lags = "".join(f"[controls.{control}]\nlag = {SERVO_LAG}\n" for control in scenes.aircraft().controls)
    scales = "".join(f"[sensors.{vane}]\nscale = {VANE_SCALE}\n" for vane in ("alpha", "beta"))
    return _as_scenes_has_it(scenes.aircraft().text + lags + scales, "twin-boom with slow servos")


def _as_scenes_has_it(text: str, where: str) -> Vehicle:
    """Return a vehicle file with the true values that `scenes` sets."""
    values = {name: {"value": value} for name, value in scenes.TRUTHS.items()}
    return scenes.with_trim_thrust(parse_vehicle(text, where).with_numbers(values))


def with_noisy_deflections(flight: Flight, rng: np.random.Generator) -> Flight:
    """Return the flight with noise on what is recorded of each control."""
    controls = {
        c: (
            flight.data[c].dims,
            flight.data[c].to_numpy() + DEFLECTION_NOISE * rng.standard_normal(flight.data[c].size),
        )
        for c in scenes.aircraft().recorded
    }
    return replace(flight, data=flight.data.assign(controls))


TRUTHS: Final[Mapping[str, Callable[[], Vehicle]]] = {
    "exact": scenes.aircraft, "terms": richer_aircraft, "gusts": scenes.turbulent_aircraft, "sensors": slower_aircraft,
    "inputs": scenes.aircraft,
}  # fmt: skip


def flown(case: str, seed: int, count: int) -> scenes.Scene:
    """Return so many maneuvers of a case; a larger number continues the smaller."""
    truth, flights = TRUTHS[case](), {}
    for i in range(count):
        rng = np.random.default_rng([seed, i])
        name, vehicle = f"maneuver{i}", scenes.with_biases(truth, rng)
        flight = simulate_flight(vehicle, drawn_maneuver(rng), seed=int(rng.integers(2**31)), name=name)
        flights[name] = with_noisy_deflections(flight, rng) if case == "inputs" else flight
    start = scenes.wrong_start(scenes.aircraft(), np.random.default_rng([seed, count]))
    windows = tuple(Window(name, 0.0, scenes.DURATION) for name in flights)
    return scenes.Scene(start, flights, windows, scenes.coefficients(scenes.aircraft()))
