"""The paper's claim that the V terms catch the propulsion: a thrust that falls with airspeed, fitted without one."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.parallel import Run
from stoop.simulation import parse_maneuver
from stoop.simulation.fly import fly
from stoop.vehicle.builtin import resolve_vehicle
from stoop.vehicle.schema import ConstantThrust, Propeller
from stoop.workflow.demo import MANEUVER, TABLE_1
from stoop_studies.findings import Results, Setting
from stoop_studies.problems.paper import Paper, box, paper
from stoop_studies.reproduce.estimates import fitted

WORK: Final = "stoop_studies.reproduce.propulsion:work"
TERMS: Final = ("CLV", "CDV", "CmV")
MODELS: Final = {
    "V terms zero": (False, False),
    "V terms free": (True, False),
    "propeller known": (False, True),
}  #: as shown -> whether V terms are free, whether the model has the propeller
PROPELLER: Final = {
    "kind": "propeller", "channel": "throttle", "speed_gain": 100.0, "diameter": 0.66, "CT0": 0.1937, "CT1": -0.1827,
}  # fmt: skip
"""Ours: about constant power, so that thrust falls by 6.3 N for each m/s, as thrust over airspeed does."""


@functools.cache
def truth() -> Paper:
    """Return the aircraft with the propeller, all V terms zero, and its flight."""
    vehicle = resolve_vehicle("twin-boom").reduced("longitudinal")
    file = vehicle.file.model_copy(update={"propulsion": Propeller.model_validate(PROPELLER)})
    vehicle = replace(vehicle, file=file)
    return Paper(vehicle, fly(vehicle, parse_maneuver(MANEUVER, "propulsion")))


@functools.cache
def model(free: bool, propeller: bool) -> Paper:
    """Return what is fitted to the truth's flight.

    Parameters
    ----------
    free : bool
        Whether the V terms are searched with the ten coefficients.
    propeller : bool
        Whether the thrust falls as it truly does; otherwise it stays at its trimmed value.
    """
    case, names = truth(), (*TABLE_1, *TERMS) if free else TABLE_1
    if propeller:
        return replace(case, names=names)
    propulsion = ConstantThrust.model_validate({"kind": "constant", "thrust": thrust(35.0)})
    vehicle = replace(case.vehicle, file=case.vehicle.file.model_copy(update={"propulsion": propulsion}))
    elevator = case.vehicle.inputs.index("elevator")  # the only input of this model
    return Paper(vehicle, replace(case.flown, inputs=case.flown.inputs[:, [elevator]]), names)


def thrust(airspeed: float) -> float:
    """Return the propeller's thrust at the trimmed throttle, N."""
    case = truth()
    number = case.vehicle.value
    speed = number("propulsion.speed_gain") * case.flown.trim.thrust["throttle"]
    diameter, density = number("propulsion.diameter"), number("environment.density")
    form = number("propulsion.CT0") * speed**2 + number("propulsion.CT1") * speed * airspeed / diameter
    return density * diameter**4 * form


def expected() -> dict[str, float]:
    """Return what the V terms should take up, to first order in the change of airspeed.

    A thrust T + T' (V - V*) along the body's x axis has the drag -T' (V - V*) cos(alpha) and the lift
    T' (V - V*) sin(alpha); over qbar S (V - V*) / V* these are CDV and CLV. Its line passes the center of gravity.
    """
    case = truth()
    number, alpha = case.vehicle.value, case.flown.trim.start["alpha"]
    airspeed = number("reference.airspeed")
    slope = (thrust(airspeed + 0.5) - thrust(airspeed - 0.5)) / 1.0
    pressure = 0.5 * number("environment.density") * airspeed**2
    unit = slope * airspeed / (pressure * number("reference.area"))
    return {"CLV": unit * float(np.sin(alpha)), "CDV": -unit * float(np.cos(alpha)), "CmV": 0.0}


def work(arguments: Mapping[str, Any], stops: Sequence[int | None]) -> list[Any]:
    """Fit one model to one flight, with the default optimizer to its end.

    Parameters
    ----------
    arguments : mapping
        ``model``: of `MODELS`; ``seed``: of box, noise and search; ``noise``: whether there is any.
    stops : sequence
        One None per result.
    """
    case, seed = model(*MODELS[str(arguments["model"])]), int(arguments["seed"])
    measured = truth().measured(seed, bool(arguments["noise"]))
    problem = case.misfit(case.bounded(*bounds(case.names, seed)), measured)
    return [fitted(problem, seed)] * len(stops)


def bounds(names: Sequence[str], seed: int) -> tuple[FloatArray, FloatArray]:
    """Return box W of the ten coefficients, and boxes of width one about zero for the V terms.

    A model that lacks something puts coefficients far off; bounds that it meets would hide how far.
    """
    low, high = box("W", seed, paper().truth)
    middles = np.random.default_rng(20_000 + seed).uniform(-0.3, 0.3, len(TERMS))
    extra = len(names) - len(TABLE_1)
    return np.append(low, (middles - 0.5)[:extra]), np.append(high, (middles + 0.5)[:extra])


def key(name: str, noise: bool, seed: int) -> str:
    """Return the name of one fit."""
    return f"propulsion/{name}/{'noise' if noise else 'clean'}/{seed:06d}"


def runs(setting: Setting) -> list[Run]:
    """Return one fit without noise and one per seed with it, of each model."""
    clean = [(name, False, setting.seed) for name in MODELS]
    noisy = [(name, True, seed) for name in MODELS for seed in setting.seeds]
    return [
        Run(key(m, noise, seed), WORK, {"model": m, "noise": noise, "seed": seed})
        for m, noise, seed in clean + noisy
    ]


@dataclass(frozen=True, eq=False)
class Fits:
    """Fits of one model.

    Attributes
    ----------
    clean : mapping
        Estimates without noise.
    cost : float
        J without noise: what the model cannot explain.
    noisy : mapping
        Name -> (n,) estimates with noise.
    costs : (n,)
        J with noise.
    """

    clean: Mapping[str, float]
    cost: float
    noisy: Mapping[str, FloatArray]
    costs: FloatArray

    def errors(self) -> FloatArray:
        """Return relative errors (10,) without noise."""
        return np.array([self.clean[n] for n in TABLE_1]) / paper().truth - 1.0


def fits(setting: Setting, results: Results) -> dict[str, Fits]:
    """Return the fits by model."""
    found = {}
    for name in MODELS:
        clean = results[key(name, False, setting.seed)]
        seeds = [results[key(name, True, s)] for s in setting.seeds]
        noisy = {n: np.array([r["values"][n] for r in seeds]) for n in clean["values"]}
        found[name] = Fits(clean["values"], clean["cost"], noisy, np.array([r["cost"] for r in seeds]))
    return found
