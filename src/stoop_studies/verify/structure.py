"""Structure determination: in how many aircraft exactly the true set of terms is found."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from stoop.estimate.regression.least_squares import FrequencyDomain
from stoop.problem.windows import Window
from stoop.simulation import trim
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import load_vehicle
from stoop.vehicle.load import parse_vehicle
from stoop.vehicle.terms import parameter_name
from stoop_analysis import structure
from stoop_studies.findings import Findings, Setting, counted, holds
from stoop_studies.verify.scenes import AIRCRAFT, ALTITUDE, multisine_maneuver, with_trim_thrust
from stoop_studies.verify.study import Samples, Verification, work

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
CRITERIA: Final[Mapping[str, tuple[str, structure.Choose]]] = {
    "f": ("stepwise, partial F", structure.stepwise),
    "press": ("stepwise, PRESS", lambda rows: structure.stepwise(rows, structure.Press())),
    "pse": ("orthogonal functions, PSE", structure.orthogonal),
}  #: as stoop structure calls them, and as the page does
DEFAULT: Final = "f"
REQUIRED_SHARE: Final = 0.9
CASE: Final = "aircraft"


@functools.cache
def full_aircraft() -> Vehicle:
    """Return the twin-boom aircraft with every candidate as a term of value zero; alpha counts from its trim."""
    base = load_vehicle(AIRCRAFT)
    level = trim(base, None, ALTITUDE).start["alpha"]
    head = base.text.split("[aerodynamics.", 1)[0].replace("alpha = 0.0", f"alpha = {level:.4f}")
    lines = [head, "[aerodynamics]", "default = false"]
    for coefficient, candidates in structure.standard_candidates(base).items():
        constant = f'{coefficient}0 = {{ term = "1", value = {CONSTANTS[coefficient]} }}'
        lines += [f"[aerodynamics.{coefficient}]", constant]
        lines += [f'{parameter_name(coefficient, t)} = {{ term = "{t}", value = 0.0 }}' for t in candidates]
    return parse_vehicle("\n".join(lines) + "\n", "twin-boom with all candidates")


def draw(seed: int) -> tuple[Vehicle, dict[str, list[str]]]:
    """Draw an aircraft; return it and the terms that it has, by coefficient."""
    rng = np.random.default_rng(seed)
    terms = {c: dict(own) for c, own in ALWAYS.items()}
    for coefficient, more in OCCASIONAL.items():
        terms[coefficient] |= {t: v for t, v in more.items() if rng.random() < CHANCE}
    values = {
        parameter_name(c, t): {"value": v * rng.uniform(1.0 - SPREAD, 1.0 + SPREAD)}
        for c, own in terms.items()
        for t, v in own.items()
    }
    vehicle = with_trim_thrust(full_aircraft().with_numbers(values))
    return vehicle, {c: list(own) for c, own in terms.items()}


def maneuver(number: int) -> Maneuver:
    """Return one of the maneuvers: multisines whose harmonics change places, and whose sign alternates."""
    low, high = EXCITED
    amplitudes = {
        control: (a if number % 2 else -a, round(low * DURATION) + (i + number) % len(AMPLITUDES))
        for i, (control, a) in enumerate(AMPLITUDES.items())
    }
    return multisine_maneuver(amplitudes, DURATION, RATE, high)


@work
def determine_terms(case: str, seed: int) -> dict[str, Any]:
    """Return the terms of the aircraft of ``seed``, and those that each criterion finds; coefficient -> terms."""
    vehicle, truth = draw(seed)
    flights = {
        f"flight{k}": simulate_flight(vehicle, maneuver(k), FLIGHTS * seed + k, name=f"flight{k}")
        for k in range(FLIGHTS)
    }
    windows = [Window(name, 0.0, DURATION) for name in flights]
    candidates = structure.standard_candidates(full_aircraft())
    found = {
        name: structure.determine(vehicle, flights, windows, candidates, choose, BAND).chosen
        for name, (_, choose) in CRITERIA.items()
    }
    chosen = {name: {c: list(own.terms) for c, own in by.items()} for name, by in found.items()}
    return {"truth": truth, "found": chosen}


def show(setting: Setting, samples: Samples) -> Findings:
    """Return how often the true terms are found."""
    results, vehicle = samples[CASE], full_aircraft()
    candidates = {c: len(group) - 1 for c, group in vehicle.terms.items()}  # less the constant
    candidates["all"] = sum(candidates.values())
    groups = {**{c: (c,) for c in ALWAYS}, "all": tuple(ALWAYS)}
    records: dict[tuple[str, str], dict[str, Any]] = {
        (criterion, name): {
            "criterion": criterion,
            "coefficient": name,
            "candidates": candidates[name],
            "aircraft": len(results),
            **tally(results, criterion, group),
        }
        for criterion in CRITERIA
        for name, group in groups.items()
    }
    best = records[DEFAULT, "all"]
    claim = holds(
        "the true set of terms of all six coefficients is found, and no other term, in at least 90 % of the aircraft",
        best["exact"] >= REQUIRED_SHARE * len(results),
        f"{counted(best['exact'], len(results))}; {best['missing_a_true_term']} lack a true term, "
        f"{best['with_a_false_term']} have a false one",
    )
    return Findings.of("Structure: are the true terms found?", (claim,), list(records.values()))


def tally(
    results: Sequence[Mapping[str, Any]], criterion: str, coefficients: Sequence[str]
) -> dict[str, int]:
    """Count the aircraft of which exactly the true terms were found, and those with a term too few or too many."""
    true, found = (
        [{(c, t) for c in coefficients for t in terms[c]} for terms in by]
        for by in ([r["truth"] for r in results], [r["found"][criterion] for r in results])
    )
    pairs = list(zip(true, found, strict=True))
    return {
        "exact": sum(t == f for t, f in pairs),
        "missing_a_true_term": sum(bool(t - f) for t, f in pairs),
        "with_a_false_term": sum(bool(f - t) for t, f in pairs),
    }


EXPERIMENT: Final = Verification("structure", show, runs=200, work="determine_terms", cases=(CASE,))
