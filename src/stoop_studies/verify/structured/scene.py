"""Aircraft whose terms are drawn, the flights that they fly, and which terms are found in them."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stoop.estimate.regression.domain import FrequencyDomain
from stoop.estimate.regression.selection import Press, orthogonal, stepwise
from stoop.estimate.regression.structure import Choose, determine, parameter_name, standard_candidates
from stoop.flight import Flight
from stoop.problem.windows import Window
from stoop.simulate import Maneuver, parse_maneuver, simulate_flight, trim
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop.vehicle.load import parse_vehicle

ALTITUDE: Final = 200.0  #: m
DURATION: Final = 25.0  #: s of each flight
RATE: Final = 50.0  #: Hz
FLIGHTS: Final = 4  #: of each aircraft
AMPLITUDES: Final = {"elevator": 0.22, "aileron": 0.08, "rudder": 0.12}  #: rad
EXCITED: Final = (0.1, 1.2)  #: Hz, of the multisines
BAND: Final = FrequencyDomain(0.04, 1.5)
SPREAD: Final = 0.2  #: every true coefficient is drawn this share about its value
CHANCE: Final = 0.5  #: that an occasional term is there
CONSTANTS: Final = {"CL": 0.876, "CD": 0.104, "CQ": 0.004, "Cl": 0.0008, "Cm": -0.0235, "Cn": -0.0006}
ALWAYS: Final[Mapping[str, Mapping[str, float]]] = {
    "CL": {"alpha": 4.78, "q": 10.47, "elevator": 0.201},
    "CD": {"alpha": 0.43},
    "CQ": {"beta": -0.35, "r": 0.22, "rudder": 0.12},
    "Cl": {"beta": -0.055, "p": -0.48, "r": 0.11, "aileron": 0.15, "rudder": 0.012},
    "Cm": {"alpha": -2.12, "q": -47.6, "elevator": -0.8},
    "Cn": {"beta": 0.085, "p": -0.035, "r": -0.13, "aileron": -0.012, "rudder": -0.075},
}  #: the twin-boom aircraft's, with alpha about its trim
OCCASIONAL: Final[Mapping[str, Mapping[str, float]]] = {
    "CL": {"alpha^2": -5.0},
    "CD": {"alpha^2": 2.5},
    "Cl": {"alpha*beta": -0.4, "alpha*r": 1.0},
    "Cm": {"alpha^2": -3.0, "alpha*elevator": 1.5},
    "Cn": {"beta^3": 0.5, "alpha*p": -1.0, "alpha*beta": 0.3},
}  #: of a size that shows in the motion
CRITERIA: Final[Mapping[str, Choose]] = {
    "f": stepwise,
    "press": lambda rows: stepwise(rows, Press()),
    "pse": orthogonal,
}  #: as stoop structure calls them


@dataclass(frozen=True)
class Drawn:
    """An aircraft: the terms that it has, by coefficient."""

    vehicle: Vehicle
    terms: Mapping[str, tuple[str, ...]]


@functools.cache
def everything() -> Vehicle:
    """Return the twin-boom aircraft with every candidate as a term of value zero; alpha counts from its trim."""
    base = resolve_vehicle("twin-boom")
    level = trim(base, None, ALTITUDE).start["alpha"]
    head = base.text.split("[aerodynamics.", 1)[0].replace("alpha = 0.0", f"alpha = {level:.4f}")
    lines = [head, "[aerodynamics]", "default = false"]
    for coefficient, candidates in standard_candidates(base).items():
        lines += [
            f"[aerodynamics.{coefficient}]",
            f'{coefficient}0 = {{ term = "1", value = {CONSTANTS[coefficient]} }}',
        ]
        lines += [f'{parameter_name(coefficient, t)} = {{ term = "{t}", value = 0.0 }}' for t in candidates]
    return parse_vehicle("\n".join(lines) + "\n", "twin-boom with all candidates")


def draw(seed: int) -> Drawn:
    """Draw an aircraft."""
    rng = np.random.default_rng(seed)
    terms = {c: dict(own) for c, own in ALWAYS.items()}
    for coefficient, more in OCCASIONAL.items():
        terms[coefficient] |= {t: v for t, v in more.items() if rng.random() < CHANCE}
    values = {
        parameter_name(c, t): {"value": v * rng.uniform(1.0 - SPREAD, 1.0 + SPREAD)}
        for c, own in terms.items()
        for t, v in own.items()
    }
    vehicle = everything().with_numbers(values)
    thrust = trim(vehicle, None, ALTITUDE).changes["propulsion.thrust"]
    known = vehicle.with_numbers({"propulsion.thrust": {"value": thrust}})
    return Drawn(known, {c: tuple(own) for c, own in terms.items()})


def maneuver(number: int) -> Maneuver:
    """Return one of the maneuvers: multisines on all controls at once that share no frequency."""
    lines = [f"duration = {DURATION}", f"rate = {RATE}", f"altitude = {ALTITUDE}"]
    low, high = EXCITED
    for i, (control, amplitude) in enumerate(AMPLITUDES.items()):
        first = round(low * DURATION) + (i + number) % len(AMPLITUDES)
        size = amplitude if number % 2 else -amplitude
        lines += [
            "[[input]]", f'control = "{control}"', 'shape = "multisine"', "start = 0.0", f"duration = {DURATION}",
            f"amplitude = {size}", f"band = {high}", f"first = {first}", f"stride = {len(AMPLITUDES)}",
        ]  # fmt: skip
    return parse_maneuver("\n".join(lines), f"maneuver {number}")


def flown(vehicle: Vehicle, seed: int) -> dict[str, Flight]:
    """Return the flights of an aircraft, with the sensor noise of its file on every channel."""
    names = [f"flight{k}" for k in range(FLIGHTS)]
    return {n: simulate_flight(vehicle, maneuver(k), FLIGHTS * seed + k, name=n) for k, n in enumerate(names)}


def found(arguments: Mapping[str, Any], stops: list[int | None]) -> list[Any]:
    """Return the terms of the aircraft of ``seed``, and those that each criterion finds; coefficient -> terms."""
    seed = int(arguments["seed"])
    drawn = draw(seed)
    flights = flown(drawn.vehicle, seed)
    windows = [Window(name, 0.0, DURATION) for name in flights]
    candidates = standard_candidates(everything())
    told = {
        name: {c: list(chosen.terms) for c, chosen in determine(
            drawn.vehicle, flights, windows, candidates, choose, BAND
        ).chosen.items()}
        for name, choose in CRITERIA.items()
    }  # fmt: skip
    return [{"truth": {c: list(t) for c, t in drawn.terms.items()}, "found": told} for _ in stops]
